"""A network's declaration: TOML in, a checked `NetworkSpec` out.

Every complaint is one line that names the file and the key and says what is allowed there.
"""

import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from core_solver.errors import ModelError
from core_solver.perception.networks.keypoint_sets import KEYPOINT_SETS
from core_solver.perception.networks.kinds import KINDS, TASKS, Kind, View, decoders_of


@dataclass(frozen=True)
class About:
    """Where a network comes from: for the reader of a catalogue, not for the solver.

    Attributes:
        project: its name.
        page: the official page.
        licence: of the weights, as their publishers state it.
        commercial: whether that licence lets anybody earn money with the results.
        data: what the terms of training data, or of weights that training began with, say beyond it.
        export: how its ONNX file is made or had, one sentence.
    """

    project: str = ""
    page: str = ""
    licence: str = ""
    commercial: bool = True
    data: str = ""
    export: str = ""


@dataclass(frozen=True)
class NetworkSpec:
    """A declared network. Pixels become `(pixel * scale - mean) / std`, in the order of `colour`.

    Attributes:
        toml: the declaration.
        file: the ONNX file.
        decoder: name in `KINDS`.
        input: (width, height) in pixels; None for what the graph fixes.
        layout: "NCHW" or "NHWC".
        colour: "rgb" or "bgr".
        mean: three numbers.
        std: three numbers.
        scale: of the 8-bit values.
        outputs: the graph's name for a role.
        constants: the graph's further inputs and their values.
        about: where it comes from.
        keypoints: name in `KEYPOINT_SETS`.
        fit: how a picture is laid into the input: "stretch", or whole with margins: "centre" or "corner".
        pad: 8-bit grey of the margins.
        padding: size of a person's crop over the person's box.
        refine: of heatmap peaks: "none", "quarter" or "dark".
        udp: heatmap and input share their corner pixels' centres, instead of their corners.
        score: finds below are dropped.
        overlap: of boxes, above which the weaker find is the same person; 1 keeps all.
        person_class: number of the class "person".
        longer_side: pixels, for a graph of free size without `input`.
        multiple: of which the sides must then be.
        focal: unit of the focal length that the network gives: "pixels" of the input, "fov-degrees", "fov-radians".
        shift: whether points lack an unknown shift along the depth, as MoGe's do.
        sees: whom an SMPL regressor is shown: "person" or "picture".
        rotations: "matrix", "6d" (two columns, interleaved), "6d-rows" (two rows) or "axis-angle".
        camera: "none", "hmr" (s, tx, ty: s * (x + tx)), "romp" (s, tx, ty: s * x + tx) or "translation" (metres).
        axes: "camera" (y down) or "y-up".
        fov_degrees: along the input's longer side, for which a "translation" holds.
    """

    toml: Path
    file: Path
    decoder: str
    input: tuple[int, int] | None
    layout: str
    colour: str
    mean: tuple[float, ...]
    std: tuple[float, ...]
    scale: float
    outputs: Mapping[str, str]
    constants: Mapping[str, float]
    about: About = About()
    keypoints: str = "coco17"
    fit: str = "centre"
    pad: int = 114
    padding: float = 1.25
    refine: str = "quarter"
    udp: bool = False
    score: float = 0.3
    overlap: float = 0.65
    person_class: int = 0
    longer_side: int = 518
    multiple: int = 14
    focal: str = "pixels"
    shift: bool = True
    sees: str = "person"
    rotations: str = "matrix"
    camera: str = "none"
    axes: str = "camera"
    fov_degrees: float = 60.0

    @property
    def kind(self) -> Kind:
        """What the decoder reads."""
        return KINDS[self.decoder]

    @property
    def view(self) -> View:
        """What the network is shown."""
        return self.kind.view or View(self.sees)

    @property
    def fits_stretched(self) -> bool:
        """Whether the whole input is picture: depth networks are always shown it so."""
        return self.kind.task == "depth" or self.fit == "stretch"


def read_spec(path: Path) -> NetworkSpec:
    """Read a declaration.

    Raises:
        ModelError: no such file, no TOML, a key that is missing, unknown, or has a value that is not allowed.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ModelError(f"there is no network declaration {path} ({error.strerror}): check --network") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ModelError(f"{path.name} is no TOML: {error}") from error
    return parse_spec(table, path)


def parse_spec(table: Mapping[str, Any], path: Path) -> NetworkSpec:
    """The declaration that a TOML file at `path` holds.

    Raises:
        ModelError: as `read_spec`.
    """
    for key in table:
        if key not in ("network", "about"):
            raise ModelError(f"{path.name}: unknown table [{key}]: allowed are [network] and [about]")
    network = table.get("network")
    if not isinstance(network, dict):
        raise ModelError(f"{path.name}: the table [network] is missing")
    decoder = _decoder(network, path)
    allowed = {**_COMMON, **{key: _READERS[key] for key in KINDS[decoder].keys}}
    for key in network:
        if key not in (*allowed, "task", "decoder"):
            raise ModelError(
                f"{path.name}: unknown key '{key}' for the decoder \"{decoder}\": "
                f"allowed are {', '.join(('task', 'decoder', *sorted(allowed)))}"
            )
    values: dict[str, Any] = {
        key: _read(network[key], key, read, path) for key, read in allowed.items() if key in network
    }
    if "file" not in values:
        raise ModelError(f"{path.name}: the key 'file' is missing: it names the ONNX file, relative to {path.name}")
    outputs = values.get("outputs", {})
    _check_roles(outputs, decoder, path)
    if values.get("sees") == "picture" and values.get("camera", "none") == "none":
        raise ModelError(
            f"{path.name}: the key 'camera' is missing: a network that sees the whole picture must say where people "
            'are: allowed are "hmr", "romp", "translation"'
        )
    values = {
        **_DEFAULTS,
        **dict(KINDS[decoder].settled),
        **values,
        "file": path.parent / values["file"],
        "outputs": outputs,
    }
    return NetworkSpec(toml=path, decoder=decoder, about=_about(table.get("about", {}), path), **values)


def _decoder(network: Mapping[str, Any], path: Path) -> str:
    task = network.get("task")
    if task not in TASKS:
        found = "is missing" if task is None else f"is {_shown(task)}"
        raise ModelError(f"{path.name}: the key 'task' {found}: allowed {_listed(TASKS)}")
    decoder, choices = network.get("decoder"), decoders_of(task)
    if decoder not in choices:
        found = "is missing" if decoder is None else f"is {_shown(decoder)}"
        raise ModelError(f"{path.name}: the key 'decoder' {found}: allowed for the task \"{task}\" {_listed(choices)}")
    return str(decoder)


def _check_roles(outputs: Mapping[str, str], decoder: str, path: Path) -> None:
    roles = [role.name for role in KINDS[decoder].roles]
    for role in outputs:
        if role not in roles:
            raise ModelError(f"{path.name}: unknown key 'outputs.{role}': allowed are {', '.join(roles)}")


def _about(table: object, path: Path) -> About:
    fields = About.__dataclass_fields__
    if not isinstance(table, dict) or any(key not in fields for key in table):
        raise ModelError(f"{path.name}: the table [about] may hold {', '.join(fields)} and nothing else")
    read = {key: _flag if key == "commercial" else _text for key in fields}
    return About(**{key: _read(value, f"about.{key}", read[key], path) for key, value in table.items()})  # type: ignore[arg-type]


def _read(value: object, key: str, read: Callable[[object], Any], path: Path) -> object:
    try:
        return read(value)
    except _NotAllowedError as error:
        raise ModelError(f"{path.name}: the key '{key}' is {_shown(value)}: allowed {error}") from None


class _NotAllowedError(Exception):
    """A value is not allowed; the message continues "allowed ..."."""


def _one_of(*choices: str) -> Callable[[object], str]:
    def read(value: object) -> str:
        if value not in choices:
            raise _NotAllowedError(_listed(choices))
        return str(value)

    return read


def _number(low: float, high: float) -> Callable[[object], float]:
    def read(value: object) -> float:
        if not _is_number(value) or not low <= float(value) <= high:  # type: ignore[arg-type]
            raise _NotAllowedError(f"is a number from {low:g} to {high:g}")
        return float(value)  # type: ignore[arg-type]

    return read


def _whole(low: int, high: int) -> Callable[[object], int]:
    def read(value: object) -> int:
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            raise _NotAllowedError(f"is a whole number from {low} to {high}")
        return value

    return read


def _text(value: object) -> str:
    if not isinstance(value, str) or not value:
        raise _NotAllowedError("is some text")
    return value


def _flag(value: object) -> bool:
    if not isinstance(value, bool):
        raise _NotAllowedError("are true, false")
    return value


def _size(value: object) -> tuple[int, int]:
    sides = value if isinstance(value, list) else []
    if len(sides) != 2 or not all(type(side) is int and 16 <= side <= 8192 for side in sides):
        raise _NotAllowedError("is [width, height] in pixels, each a whole number from 16 to 8192")
    width, height = sides
    return width, height


def _channels(*, positive: bool) -> Callable[[object], tuple[float, ...]]:
    def read(value: object) -> tuple[float, ...]:
        good = isinstance(value, list) and len(value) == 3 and all(_is_number(n) for n in value)
        if not good or (positive and min(value) <= 0):  # type: ignore[type-var]
            raise _NotAllowedError(f"are three {'positive ' if positive else ''}numbers, in the order of 'colour'")
        return tuple(float(n) for n in value)  # type: ignore[union-attr]

    return read


def _names(value: object) -> dict[str, str]:
    if not isinstance(value, dict) or not all(isinstance(name, str) for name in value.values()):
        raise _NotAllowedError('is a table of role = "the output\'s name in the file"')
    return value


def _numbers(value: object) -> dict[str, float]:
    if not isinstance(value, dict) or not all(_is_number(number) for number in value.values()):
        raise _NotAllowedError("is a table of input name = number")
    return value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _listed(choices: tuple[str, ...]) -> str:
    return ("are " if len(choices) > 1 else "is ") + ", ".join(f'"{choice}"' for choice in choices)


def _shown(value: object) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else str(value)


_COMMON: dict[str, Callable[[object], Any]] = {
    "file": _text,
    "input": _size,
    "layout": _one_of("NCHW", "NHWC"),
    "colour": _one_of("rgb", "bgr"),
    "mean": _channels(positive=False),
    "std": _channels(positive=True),
    "scale": _number(1e-6, 1e6),
    "outputs": _names,
    "constants": _numbers,
}

_DEFAULTS: dict[str, Any] = {
    "input": None, "layout": "NCHW", "colour": "rgb", "mean": (0.0, 0.0, 0.0), "std": (1.0, 1.0, 1.0), "scale": 1.0,
    "constants": {},
}  # fmt: skip

_READERS: dict[str, Callable[[object], Any]] = {
    "keypoints": _one_of(*KEYPOINT_SETS),
    "fit": _one_of("centre", "corner", "stretch"),
    "pad": _whole(0, 255),
    "padding": _number(0.5, 4),
    "refine": _one_of("none", "quarter", "dark"),
    "udp": _flag,
    "score": _number(0, 1),
    "overlap": _number(0, 1),
    "person_class": _whole(0, 100_000),
    "longer_side": _whole(32, 8192),
    "multiple": _whole(1, 256),
    "focal": _one_of("pixels", "fov-degrees", "fov-radians"),
    "shift": _flag,
    "sees": _one_of("person", "picture"),
    "rotations": _one_of("matrix", "6d", "6d-rows", "axis-angle"),
    "camera": _one_of("none", "hmr", "romp", "translation"),
    "axes": _one_of("camera", "y-up"),
    "fov_degrees": _number(5, 150),
}
