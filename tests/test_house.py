"""The rules of the house, read off the sources: who may import whom, what nobody may do, and one version everywhere."""

import ast
import functools
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import core_solver

ROOT = Path(__file__).resolve().parents[1]
SOLVER = sorted((ROOT / "core_solver").rglob("*.py"))
ADDON = sorted((ROOT / "blender_addon").rglob("*.py"))
PRODUCT = [*SOLVER, *ADDON, ROOT / "build.py"]
TESTS = sorted((ROOT / "tests").rglob("*.py"))
MOST_LINES = 450

# Rooms from the cellar up; a room may import itself and everything below the line it stands on, but no neighbour.
# `perception.observations` and `tracking.tracks` hold only the data classes that pass between rooms (what was seen,
# who was where), so they stand below the rooms that fill them and those that read them.
FLOORS: tuple[tuple[str, ...], ...] = (
    ("errors", "progress", "geometry"),
    ("take", "text_files"),
    ("camera", "body"),
    ("perception.observations", "tracking.tracks"),
    ("energy", "raster", "video", "camera_metadata"),
    ("footage",),
    ("perception", "tracking", "scene", "stabilise", "preview"),
    ("optimise",),  # its stages draw on `scene` for samples of the floor and for contacts
    (
        "assemble",
        "camera_estimation",
    ),
    ("interchange", "evaluation", "inspection", "console", "report"),
    ("pipeline",),
    ("cli",),
)
SHARED_DATA = {"perception.observations", "tracking.tracks"}

# What a room may use besides its floor's rule.
ONLY_NUMPY = {"take", "geometry", "errors", "progress"}
TORCH_TWIN = "core_solver/geometry/torch_ops.py"
MAY_PRINT = {
    "core_solver/cli.py",
    "core_solver/perception/models_cli.py",
    "core_solver/raster/benchmark.py",
    "build.py",
}
RESTRICTED_UNPICKLER = "core_solver/body/smpl_file.py"
ADDON_MAY_IMPORT = {"take", "geometry", "errors"}
PICKLERS = {"pickle", "_pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve"}


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@functools.cache
def parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def imports(path: Path) -> Iterator[str]:
    """Dotted names of all that a file imports, inside functions too; the add-on's relative ones start with dots."""
    for node in ast.walk(parse(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            yield module
            yield from (f"{module}.{alias.name}" for alias in node.names)


def top_level(path: Path) -> set[str]:
    return {name.partition(".")[0] for name in imports(path) if not name.startswith(".")}


def room_of(module: str) -> str:
    """The room of a module of ours, given without `core_solver.`."""
    for shared in SHARED_DATA:
        if module == shared or module.startswith(shared + "."):
            return shared
    return module.partition(".")[0]


def own_room(path: Path) -> str:
    return room_of(".".join(path.relative_to(ROOT / "core_solver").with_suffix("").parts))


def rooms_imported(path: Path) -> set[str]:
    """Rooms of the solver that a file draws on; a shared data module names itself rather than its folder."""
    names = {name.removeprefix("core_solver.") for name in imports(path) if name.startswith("core_solver.")}
    # `from core_solver.tracking.tracks import Track` yields the module and its member: both are the same room.
    return {room_of(name) for name in names - {"__version__"}}


def floor_of(room: str) -> int:
    floors = [number for number, rooms in enumerate(FLOORS) if room in rooms]
    assert floors, f"the room {room} stands on no floor: give it one in FLOORS"
    return floors[0]


def calls(path: Path) -> Iterator[ast.Call]:
    return (node for node in ast.walk(parse(path)) if isinstance(node, ast.Call))


def is_unsafe(call: ast.Call) -> bool:
    name, given = ast.unparse(call.func), {k.arg: ast.unparse(k.value) for k in call.keywords}
    return (
        name in {"pickle.load", "pickle.loads", "eval", "exec"}
        or (name in {"np.load", "numpy.load"} and given.get("allow_pickle") != "False")
        or (name == "torch.load" and given.get("weights_only") != "True")
    )


# --- the parser itself ---


def test_the_reader_of_imports_sees_every_form(tmp_path: Path) -> None:
    source = "import a.b\nfrom c import d\nfrom . import e\ndef f():\n    from core_solver.tracking.tracks import g\n"
    (tmp_path / "x.py").write_text(source)
    assert {"a.b", "c", "c.d", ".", "..e", "core_solver.tracking.tracks"} <= set(imports(tmp_path / "x.py"))
    assert rooms_imported(tmp_path / "x.py") == {"tracking.tracks"}
    assert top_level(tmp_path / "x.py") == {"a", "c", "core_solver"}


def test_there_is_something_to_check() -> None:
    assert len(SOLVER) > 50
    assert len(ADDON) > 10
    assert {own_room(path) for path in SOLVER} >= {"take", "geometry", "camera", "perception", "tracking.tracks", "cli"}


# --- who may import whom ---


def test_dependencies_point_downwards() -> None:
    upward = [
        f"{relative(path)} imports {other}"
        for path in SOLVER
        for other in rooms_imported(path) - {own_room(path)}
        if own_room(path) == "__init__" or floor_of(other) >= floor_of(own_room(path))
    ]
    assert not upward


def test_take_and_geometry_use_nothing_of_ours_but_errors() -> None:
    cellar = [path for path in SOLVER if own_room(path) in {"take", "geometry"}]
    assert len(cellar) > 10
    assert not {
        relative(path): rooms_imported(path) for path in cellar if rooms_imported(path) - {own_room(path), "errors"}
    }


def test_the_cellar_needs_only_numpy() -> None:
    allowed = {"numpy", "core_solver"} | sys.stdlib_module_names
    cellar = [path for path in SOLVER if own_room(path) in ONLY_NUMPY and relative(path) != TORCH_TWIN]
    assert not {relative(path): top_level(path) - allowed for path in cellar if top_level(path) - allowed}
    assert top_level(ROOT / TORCH_TWIN) == {"torch"}


def test_the_solver_knows_nothing_of_blender() -> None:
    blenders = {"bpy", "bmesh", "mathutils", "bl_ext", "blender_addon"}
    assert not [relative(path) for path in SOLVER if top_level(path) & blenders]


def test_private_names_stay_in_their_module() -> None:
    private = re.compile(r"core_solver\.(\w+\.)*_(?!_)\w+")
    taken = [
        f"{relative(path)} imports {name}" for path in PRODUCT for name in imports(path) if private.fullmatch(name)
    ]
    assert not taken


def test_the_addon_sees_only_takes_and_geometry() -> None:
    heavy = {"torch", "cv2", "onnxruntime", "scipy"}
    assert not {relative(path): rooms_imported(path) for path in ADDON if rooms_imported(path) - ADDON_MAY_IMPORT}
    assert not [relative(path) for path in ADDON if top_level(path) & heavy]


def test_the_task_runner_needs_a_bare_python() -> None:
    assert top_level(ROOT / "build.py") <= set(sys.stdlib_module_names)


# --- what nobody may do ---


def test_only_command_lines_print() -> None:
    printing = {relative(path) for path in PRODUCT for call in calls(path) if ast.unparse(call.func) == "print"}
    assert printing <= MAY_PRINT
    assert "core_solver/cli.py" in printing  # or this test no longer sees anything


def test_nothing_is_unpickled_but_by_the_restricted_reader() -> None:
    assert {relative(path) for path in PRODUCT if top_level(path) & PICKLERS} == {RESTRICTED_UNPICKLER}
    readers = [node for node in ast.walk(parse(ROOT / RESTRICTED_UNPICKLER)) if isinstance(node, ast.ClassDef)]
    restricted = [r for r in readers if [ast.unparse(base) for base in r.bases] == ["pickle.Unpickler"]]
    assert restricted
    assert all("find_class" in {m.name for m in r.body if isinstance(m, ast.FunctionDef)} for r in restricted)


def test_no_call_runs_what_a_file_says() -> None:
    unsafe = [
        f"{relative(path)}:{call.lineno} {ast.unparse(call)}"
        for path in PRODUCT
        for call in calls(path)
        if is_unsafe(call)
    ]
    assert not unsafe


@pytest.mark.parametrize(
    ("source", "unsafe"),
    [
        ("np.load(p)", True), ("np.load(p, allow_pickle=True)", True), ("np.load(p, allow_pickle=False)", False),
        ("torch.load(p)", True), ("pickle.loads(b)", True), ("eval(t)", True), ("json.loads(t)", False),
    ],
)  # fmt: skip
def test_unsafe_calls_are_recognised(source: str, unsafe: bool) -> None:
    call = ast.parse(source, mode="eval").body
    assert isinstance(call, ast.Call)
    assert is_unsafe(call) == unsafe


def test_files_stay_short() -> None:
    lengths = {relative(path): len(path.read_text(encoding="utf-8").splitlines()) for path in [*PRODUCT, *TESTS]}
    assert not {name: length for name, length in lengths.items() if length > MOST_LINES}


def test_every_file_of_the_addon_names_its_licence() -> None:
    line = "# SPDX-License-Identifier: GPL-3.0-or-later"
    assert not [relative(path) for path in ADDON if not path.read_text(encoding="utf-8").startswith(line + "\n")]


# --- one version ---


def test_one_version_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    manifest = tomllib.loads((ROOT / "blender_addon" / "blender_manifest.toml").read_text(encoding="utf-8"))
    newest = re.search(r"^## .*?(\d+\.\d+\.\d+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert newest is not None
    assert project["version"] == core_solver.__version__ == manifest["version"] == newest[1]
