"""SMPL poses from ROMP's and BEV's .npz files, or from plain arrays."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_solver.body.kinematics import pose_joints, skin
from core_solver.body.model import BodyModel
from core_solver.errors import UserError
from core_solver.perception.precomputed.files import as_identity, as_numbers, as_whole_number, read_archive
from core_solver.perception.precomputed.numbering import frame_numbers

Array = NDArray[np.float64]

_JOINTS = 24
_THETA_NAMES = ("smpl_thetas", "thetas", "theta", "poses", "pose")
_PARTS = ("global_orient", "body_pose")
_POINTS_NAME, _CAMERA_NAME, _ID_NAMES = "pj2d_org", "cam", ("track_ids", "ids")
_WILDEST = 4 * np.pi  # radians: no rotation vector of a joint is longer
_HIPS = [11, 12]  # of our keypoints


@dataclass(frozen=True)
class GivenPose:
    """One person's SMPL pose.

    Attributes:
        theta: (24, 3) rotation vectors, radians; the first turns the body into the camera's axes (x right, y down, z
            forward) as seen along the person's own viewing ray.
        points: (24, 2) where the joints fall in the picture, pixels; None where the file does not say.
        camera: (3,) ROMP's weak perspective: scale, then shift down and right, in a square of side 2 around the
            picture; None where the file does not say.
        identity: the same number for the same person in all frames; None where the file does not say.
    """

    theta: Array
    points: Array | None
    camera: Array | None
    identity: int | None = None


def read_smpl(path: Path) -> Mapping[int, tuple[GivenPose, ...]]:
    """Poses by frame number.

    Args:
        path: an .npz file for all frames, or a folder with one for each, numbered like the frames.

    Raises:
        UserError: nothing there, damaged, or numbers that cannot be poses.
    """
    files = [path] if path.is_file() else sorted(path.glob("*.npz"))
    # Beside its frames ROMP may leave a summary of them all, whose name has no number.
    numbered = [file for file in files if any(c.isdigit() for c in file.stem)]
    if not files:
        raise UserError(f"{path} holds no .npz files with SMPL poses: put ROMP's or BEV's there")
    if len(files) == 1 and (path.is_file() or not numbered):
        whole = _read_all(files[0])
        if whole is not None:
            return _unique_identities(whole)
    frames = dict(zip(frame_numbers([f.name for f in numbered or files]), numbered or files, strict=True))
    return _unique_identities({number: _poses(_results(file), file) for number, file in frames.items()})


def landmarks_from(theta: Array, body: BodyModel) -> NDArray[np.float32]:
    """Landmarks (25, 3) of an average body in a pose (24, 3): metres, camera axes, origin at the mid-hips."""
    rest = body.rest_joints(body.neutral_betas)
    rotations, positions = pose_joints(theta, rest)
    points = skin(body.rest_keypoints(body.neutral_betas), body.keypoint_weights, rotations, positions, rest)
    return (points - points[_HIPS].mean(axis=0)).astype(np.float32)


def joint_pixels(pose: GivenPose, body: BodyModel, size: tuple[int, int]) -> Array | None:
    """Where a pose's joints (24, 2) fall in a picture (width, height); None where its file does not say.

    ROMP sees the picture padded to a square, which runs from -1 to 1.
    """
    if pose.points is not None or pose.camera is None:
        return pose.points
    _, joints = pose_joints(pose.theta, body.rest_joints(body.neutral_betas))
    scale, down, right = pose.camera
    in_square = scale * joints[:, :2] + (right, down)
    return in_square * max(size) / 2 + np.array(size) / 2


def _results(file: Path) -> Any:
    archive = read_archive(file, with_objects=True)
    results = archive.get("results", archive)
    return results.item() if isinstance(results, np.ndarray) and results.ndim == 0 else results


def _read_all(file: Path) -> dict[int, tuple[GivenPose, ...]] | None:
    """Poses of all frames in one file; None for a file of a single frame."""
    results = _results(file)
    if isinstance(results, dict) and "frames" in results:
        return _split_by_frames(results, file)
    if isinstance(results, dict) and results and all(isinstance(v, dict | list) for v in results.values()):
        names = [str(name) for name in results]
        try:
            numbers = frame_numbers(names)
        except UserError as error:
            raise UserError(f"{file}: {error}") from error
        return {number: _poses(value, file) for number, value in zip(numbers, results.values(), strict=True)}
    if any(c.isdigit() for c in file.stem):
        return None
    raise UserError(f'{file} does not say which frames it speaks of: give it an array "frames", or a file a frame')


def _split_by_frames(results: Mapping[str, Any], file: Path) -> dict[int, tuple[GivenPose, ...]]:
    frames = as_numbers(results["frames"], file, "frames").ravel()
    poses = _poses({name: value for name, value in results.items() if name != "frames"}, file)
    numbers = [as_whole_number(frame) for frame in frames.tolist()]
    if len(numbers) != len(poses) or None in numbers:
        raise UserError(f'{file}: "frames" must be one whole number for each of its {len(poses)} poses')
    split: dict[int, tuple[GivenPose, ...]] = {}
    for number, pose in zip(numbers, poses, strict=True):
        if number is not None:
            split[number] = (*split.get(number, ()), pose)
    return split


def _poses(results: Any, file: Path) -> tuple[GivenPose, ...]:
    """People from one table of stacked arrays, or, as ROMP's first version wrote them, from a list of tables."""
    if isinstance(results, np.ndarray) and (results.dtype == object or results.size == 0):
        results = results.ravel().tolist()
    if results is None or (isinstance(results, dict) and not results):
        return ()
    if isinstance(results, list):
        return tuple(pose for entry in results for pose in _poses(entry, file))
    if not isinstance(results, dict):
        raise UserError(f"{file} holds no table of SMPL poses: write it again with ROMP or BEV")
    theta = _thetas(results, file)
    count = len(theta)
    points = _rows(results, _POINTS_NAME, count, file)
    points = None if points is None else points.reshape(count, -1, 2)[:, :_JOINTS]
    if points is not None and points.shape[1] < _JOINTS:
        raise UserError(f"{file}: {_POINTS_NAME} has {points.shape[1]} points, but SMPL's {_JOINTS} joints come first")
    cameras = _rows(results, _CAMERA_NAME, count, file)
    if cameras is not None and cameras.shape != (count, 3):
        raise UserError(f"{file}: {_CAMERA_NAME} must be scale and shift, 3 numbers a person")
    identities = _identities(results, count)
    return tuple(
        GivenPose(
            theta[i],
            None if points is None else points[i],
            None if cameras is None else cameras[i],
            identities[i],
        )
        for i in range(count)
    )


def _thetas(results: Mapping[str, Any], file: Path) -> Array:
    """(n, 24, 3); hands that are left out are stretched."""
    name = next((n for n in _THETA_NAMES if results.get(n) is not None), None)
    if name is not None:
        flat = as_numbers(results[name], file, name)
        flat = flat.reshape(-1, flat.shape[-1] if flat.ndim == 2 else max(flat.size, 1))
    elif all(results.get(part) is not None for part in _PARTS):
        parts = [as_numbers(results[part], file, part) for part in _PARTS]
        if len({len(np.atleast_2d(part)) for part in parts}) > 1:
            raise UserError(f"{file}: global_orient and body_pose are of different people: write it again")
        parts = [np.atleast_2d(part).reshape(len(np.atleast_2d(part)), -1) for part in parts]
        flat = np.concatenate(parts, axis=1)
    else:
        raise UserError(f"{file} names no SMPL pose: it needs smpl_thetas, or global_orient and body_pose")
    if flat.size == 0:
        return np.zeros((0, _JOINTS, 3))
    if flat.shape[1] not in (66, 72):
        raise UserError(f"{file}: {flat.shape[1]} numbers are no SMPL pose, which has 72 (axis-angle of 24 joints)")
    if not np.isfinite(flat).all() or np.abs(flat).max() > _WILDEST:
        raise UserError(f"{file} holds SMPL poses that are no rotations in radians: write it again")
    return np.pad(flat, ((0, 0), (0, 72 - flat.shape[1]))).reshape(-1, _JOINTS, 3)


def _rows(results: Mapping[str, Any], name: str, count: int, file: Path) -> Array | None:
    """An array with one row a person; None without, or with what is no number."""
    if results.get(name) is None:
        return None
    values = as_numbers(results[name], file, name)
    if count == 0 or not np.isfinite(values).all():
        return None
    values = values[None] if count == 1 and (values.ndim == 1 or len(values) != 1) else values
    if len(values) != count or values.size % (2 * count if name == _POINTS_NAME else count):
        raise UserError(f"{file}: {name} must have one row for each of its {count} people")
    return values


def _identities(results: Mapping[str, Any], count: int) -> list[int | None]:
    given = next((results[n] for n in _ID_NAMES if results.get(n) is not None), None)
    if given is None:
        return [None] * count
    numbers = [as_identity(value) for value in np.ravel(np.asarray(given)).tolist()]
    return numbers if len(numbers) == count else [None] * count


def _unique_identities(frames: Mapping[int, tuple[GivenPose, ...]]) -> Mapping[int, tuple[GivenPose, ...]]:
    """Identities as they are; none at all if they name two people of one frame."""
    for poses in frames.values():
        known = [p.identity for p in poses if p.identity is not None]
        if len(known) != len(set(known)):
            return without_identities(frames)
    return frames


def without_identities(frames: Mapping[int, tuple[GivenPose, ...]]) -> Mapping[int, tuple[GivenPose, ...]]:
    """The same poses, of people to be tracked."""
    return {number: tuple(replace(p, identity=None) for p in poses) for number, poses in frames.items()}
