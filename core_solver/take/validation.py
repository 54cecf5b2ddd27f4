"""What must hold of every take, checked on reading and on writing."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_solver.errors import TakeError
from core_solver.take import keys
from core_solver.take.model import Person, Take


def check_take(take: Take) -> None:
    """Check shapes, types, finiteness and indices.

    Raises:
        TakeError: names the entry and what is wrong with it.
    """
    if take.times.ndim != 1 or len(take.times) == 0:
        raise TakeError("a take needs at least one frame")
    if not np.all(np.isfinite(take.times)) or np.any(np.diff(take.times) <= 0):
        raise TakeError("the frame times must be finite and increasing")
    if take.meta.frame_rate <= 0:
        raise TakeError("the frame rate must be positive")
    _check_skeleton(take)
    _check_directions(take)
    for index, person in enumerate(take.people):
        _check_person(person, index, take.frame_count)
    lengths: dict[str, int] = {"T": take.frame_count}
    for field, spec in keys.SCENE_ARRAYS.items():
        key = keys.SCENE.format(field=field)
        _check_array(key, getattr(take.scene, field), spec, lengths)


def _check_skeleton(take: Take) -> None:
    names, parents = take.meta.joint_names, take.meta.parents
    if len(names) != 24 or len(parents) != 24 or len(set(names)) != 24:
        raise TakeError("a take has 24 differently named joints")
    if parents[0] != -1 or any(not 0 <= parent < joint for joint, parent in enumerate(parents) if joint):
        raise TakeError("joints must follow their parents, the pelvis first")


def _check_directions(take: Take) -> None:
    for name, vector in (("gravity", take.meta.gravity), ("ground normal", take.meta.ground.normal)):
        if not abs(float(np.linalg.norm(vector)) - 1) < 1e-3:
            raise TakeError(f"the {name} must be a unit vector")
    if not np.isfinite(take.meta.ground.offset) or np.dot(take.meta.gravity, take.meta.ground.normal) >= 0:
        raise TakeError("the ground's normal must point against gravity")
    camera = take.meta.camera
    if not (camera.fx > 0 and camera.fy > 0 and camera.width > 0 and camera.height > 0):
        raise TakeError("the camera's focal lengths and image size must be positive")


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
    if np.issubdtype(spec.dtype, np.floating) != np.issubdtype(array.dtype, np.floating):
        raise TakeError(f"the entry {key} holds {array.dtype} instead of {np.dtype(spec.dtype)}")
    if np.issubdtype(array.dtype, np.floating) and key not in keys.MAY_BE_NAN and not np.all(np.isfinite(array)):
        raise TakeError(f"the entry {key} holds values that are not finite")
