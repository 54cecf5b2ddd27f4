import json
import subprocess
import sys
from argparse import ArgumentTypeError
from types import SimpleNamespace

import pytest

from core_solver import body as bodies
from core_solver import cli
from core_solver.evaluation import cli as evaluation_cli
from core_solver.evaluation import synthetic
from core_solver.evaluation.processes import Job
from core_solver.perception.store import ModelStore
from tests.solver.body.synthetic import make_stick_body
from tests.solver.evaluation.fakes import good_and_broken, start_here

KEYS = [
    "preset", "ablation", "seeds", "mrpe_mm", "ap25_matched", "ap25", "pck3d", "mpjpe_mm", "pa_mpjpe_mm",
    "jitter_paper_mm", "jitter_wham", "skate_mm", "penetration_mm", "contact_f1", "height_error", "group_w_mm",
    "depth_order", "seconds", "peak_mb",
]  # fmt: skip


def run(capsys, *arguments) -> tuple[int, str, str]:
    code = cli.main(["evaluate", "synthetic", *(str(a) for a in arguments)])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture
def tiny(monkeypatch, tmp_path):
    """A standard suite of tiny scenes on the box body."""

    def use(scenes, count):
        monkeypatch.setattr(synthetic, "suite_scenes", lambda _suite, seed, *_: scenes(seed))
        monkeypatch.setattr(synthetic, "SUITES", {"standard": SimpleNamespace(kinds=range(count))})

    monkeypatch.setattr(ModelStore, "require", lambda *_: tmp_path)
    monkeypatch.setattr(bodies, "load_body", lambda _: make_stick_body())
    return use


@pytest.fixture
def no_matplotlib(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)


def test_a_run_leaves_table_rows_scenes_and_pictures(capsys, tiny, tmp_path):
    pytest.importorskip("matplotlib")
    tiny(lambda seed: [next(good_and_broken(seed))], 1)
    out = tmp_path / "results"
    code, said, progress = run(capsys, "--seed", "2", "--preset", "baseline", "-o", out)
    assert code == 0
    assert said.splitlines()[2].startswith("baseline ")
    assert "100 %" in progress
    results = json.loads((out / "results.json").read_text())
    (row,) = results["rows"]
    assert list(row) == KEYS
    assert (row["preset"], row["ablation"], row["seeds"]) == ("baseline", "none", [2])
    assert results["failures"] == []
    facts = results["provenance"]
    assert (facts["suite"], facts["seeds"], facts["body"]) == ("standard", [2], "stick-body-1")
    assert facts["versions"]["numpy"]
    assert facts["noise"]["keypoint"] > 0
    (scene,) = json.loads((out / "scenes.json").read_text())["scenes"]
    assert (scene["scene"], scene["seed"]) == ("good", 2)
    assert scene["measures"]["mrpe_mm"] == pytest.approx(row["mrpe_mm"])
    assert "| baseline |" in (out / "table.md").read_text()
    for name in ("measures.png", "root_errors.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")

    # The same command again solves nothing, and programs may read the rows.
    tiny(lambda _: pytest.fail("generated again"), 1)
    code, said, _ = run(capsys, "--seed", "2", "--preset", "baseline", "-o", out, "--json")
    assert code == 0
    assert json.loads(said) == {"rows": [row]}


def test_a_failing_solve_is_named_and_ends_with_one(capsys, tiny, tmp_path, no_matplotlib, monkeypatch):
    monkeypatch.setattr(Job, "start", start_here)
    tiny(good_and_broken, 2)
    code, said, told = run(capsys, "--preset", "baseline", "-o", tmp_path / "r", "--jobs", "2")
    assert code == 1
    assert "baseline" in said
    last = told.strip().splitlines()[-1]
    assert "scene broken of seed 0 was not solved by baseline" in last
    results = json.loads((tmp_path / "r" / "results.json").read_text())
    assert results["failures"] == [last]
    assert len(results["rows"]) == 1
    # Without matplotlib there is a note and no picture.
    assert "scene-aware-mocap[benchmarks]" in told
    assert not list((tmp_path / "r").glob("*.png"))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), ("-o",)),
        (("-o", "{dir}/r", "--suite", "dance"), ("dance", "standard")),
        (("-o", "{dir}/r", "--seed", "many"), ("many",)),
        (("-o", "{dir}/r", "--preset", "slowest"), ("slowest", "baseline", "fast")),
        (("-o", "{dir}/r", "--motions", "{dir}/nothing"), ("nothing", "--motions")),
        (("-o", "{dir}/r", "--jobs", "0"), ("'0'",)),
        (("-o", "{dir}/file/r", "--preset", "baseline"), ("file", "-o")),
    ],
)
def test_bad_input_is_refused_on_one_line(capsys, tmp_path, arguments, words):
    (tmp_path / "file").write_text("")
    code, out, err = run(capsys, *(a.format(dir=tmp_path) for a in arguments))
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    for word in words:
        assert word in err


def test_bad_input_is_refused_from_a_fresh_process(tmp_path):
    command = [
        sys.executable,
        "-m",
        "core_solver.cli",
        "evaluate",
        "synthetic",
        "--suite",
        "dance",
        "-o",
        str(tmp_path),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")


@pytest.mark.parametrize(
    ("text", "seeds"),
    [("3", (3,)), ("0-9", tuple(range(10))), ("0,2,5-7", (0, 2, 5, 6, 7)), ("4,1-4", (1, 2, 3, 4)), ("7-7", (7,))],
)
def test_seeds_are_numbers_ranges_and_lists(text, seeds):
    assert evaluation_cli.parse_seeds(text) == seeds


@pytest.mark.parametrize("text", ["", "-1", "1-", "a", "1;2", "9-0", "0-99999999", "1,,2", "1.5"])
def test_other_seeds_are_refused(text):
    with pytest.raises(ArgumentTypeError):
        evaluation_cli.parse_seeds(text)


def test_the_suites_offered_are_the_suites_there_are():
    assert set(evaluation_cli.SUITES) == set(synthetic.SUITES)
