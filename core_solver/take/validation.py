"""What must hold of every take, checked on reading and on writing."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_solver.errors import TakeError
from core_solver.take import keys
from core_solver.take.model import CameraModel, Meta, Person, Take

_FLAT = 1e-9  # determinant of a map that takes a picture to a line


def check_take(take: Take) -> None:
    """Check shapes, types, finiteness, indices and the facts in `meta`.

    Raises:
        TakeError: names the entry and what is wrong with it.
    """
    _check_array(keys.TIMES, take.times, keys.TIMES_ARRAY, {})
    if len(take.times) == 0:
        raise TakeError("a take needs at least one frame")
    if np.any(np.diff(take.times) <= 0):
        raise TakeError("the frame times must be increasing")
    _check_clock(take.meta)
    _check_skeleton(take.meta)
    _check_directions(take.meta)
    _check_camera(take.meta.camera)
    if take.steadying is not None:
        _check_steadying(take.steadying, take.frame_count)
    for index, person in enumerate(take.people):
        _check_facts(person, index)
        _check_person(person, index, take.frame_count)
    if len({person.id for person in take.people}) < len(take.people):
        raise TakeError("two people have the same id")
    lengths: dict[str, int] = {"T": take.frame_count}
    for field, spec in keys.SCENE_ARRAYS.items():
        key = keys.SCENE.format(field=field)
        _check_array(key, getattr(take.scene, field), spec, lengths)


def _check_clock(meta: Meta) -> None:
    if meta.frame_rate <= 0:
        raise TakeError("the frame rate must be positive")
    if meta.first_frame < 0 or meta.frame_step < 1:
        raise TakeError("the first frame must not be negative, and the frame step must be positive")


def _check_skeleton(meta: Meta) -> None:
    names, parents = meta.joint_names, meta.parents
    if len(names) != 24 or len(parents) != 24 or len(set(names)) != 24:
        raise TakeError("a take has 24 differently named joints")
    if parents[0] != -1 or any(not 0 <= parent < joint for joint, parent in enumerate(parents) if joint):
        raise TakeError("joints must follow their parents, the pelvis first")


def _check_directions(meta: Meta) -> None:
    for name, vector in (("gravity", meta.gravity), ("ground normal", meta.ground.normal)):
        if not abs(float(np.linalg.norm(vector)) - 1) < 1e-3:
            raise TakeError(f"the {name} must be a unit vector")
    if not np.isfinite(meta.ground.offset) or np.dot(meta.gravity, meta.ground.normal) >= 0:
        raise TakeError("the ground's normal must point against gravity")


def _check_camera(camera: CameraModel) -> None:
    if not np.all(np.isfinite((camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion))):
        raise TakeError("the camera holds values that are not finite")
    if not (camera.fx > 0 and camera.fy > 0 and camera.width > 0 and camera.height > 0):
        raise TakeError("the camera's focal lengths and image size must be positive")


def _check_steadying(maps: NDArray[Any], frame_count: int) -> None:
    _check_array(keys.STEADYING, maps, keys.STEADYING_ARRAY, {"T": frame_count})
    if np.any(np.abs(np.linalg.det(maps)) < _FLAT):
        raise TakeError(f"the entry {keys.STEADYING} holds maps that cannot be undone")


def _check_facts(person: Person, index: int) -> None:
    if not 0 <= person.height_m < np.inf:
        raise TakeError(f"the height of person {index} must be a length")
    if not all(0 <= part <= 1 for part in person.colour):
        raise TakeError(f"the colour of person {index} must lie between 0 and 1")


def _check_person(person: Person, index: int, frame_count: int) -> None:
    lengths: dict[str, int] = {"T": frame_count}
    for field, spec in keys.PERSON_ARRAYS.items():
        key = keys.PERSON.format(index=index, field=field)
        _check_array(key, np.asarray(getattr(person, field)), spec, lengths)
    if not person.scale > 0:
        raise TakeError(f"the scale of person {index} must be positive")
    if person.faces.size and not 0 <= person.faces.min() <= person.faces.max() < lengths["V"]:
        raise TakeError(f"the faces of person {index} name vertices that do not exist")
    if person.weight_joints.size and person.weight_joints.max() >= 24:
        raise TakeError(f"the skinning weights of person {index} name joints that do not exist")
    if person.weights.size and np.max(np.abs(person.weights.sum(axis=1) - 1)) > 1e-2:
        raise TakeError(f"the skinning weights of person {index} must sum to 1 at each vertex")


def _check_array(key: str, array: NDArray[Any], spec: keys.ArraySpec, lengths: dict[str, int]) -> None:
    wanted = tuple(lengths.get(n, n) if isinstance(n, str) else n for n in spec.shape)
    if array.ndim != len(wanted) or any(
        isinstance(w, int) and w != n for w, n in zip(wanted, array.shape, strict=True)
    ):
        raise TakeError(f"the entry {key} has shape {array.shape} instead of {wanted}")
    lengths.update({n: array.shape[i] for i, n in enumerate(spec.shape) if isinstance(n, str)})
    if array.dtype.kind != np.dtype(spec.dtype).kind:
        raise TakeError(f"the entry {key} holds {array.dtype} instead of {np.dtype(spec.dtype)}")
    if array.dtype.kind == "f":
        _check_finite(key, array, spec)


def _check_finite(key: str, array: NDArray[Any], spec: keys.ArraySpec) -> None:
    with np.errstate(over="ignore"):  # what is too large for the file's type becomes infinite there
        stored = array.astype(spec.dtype, copy=False)
    bad = np.isinf(stored) if key in keys.MAY_BE_NAN else ~np.isfinite(stored)
    if np.any(bad):
        raise TakeError(f"the entry {key} holds values that are not finite")
