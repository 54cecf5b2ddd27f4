"""What the solver fits: tracks in the units of the energies, one array for all people."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.camera import Camera
from core_solver.geometry import align_vectors
from core_solver.tracking.tracks import Modalities, Track

Array = NDArray[np.float64]

_MIN_SIZE_PX = 16.0
_LANDMARK_DEPTH = 0.8  # expected depth within a body, as a share of what a network says


@dataclass(frozen=True)
class Evidence:
    """N people over T frames.

    Attributes:
        seconds: (T - 1,) between frames.
        times: (T,) seconds.
        valid: (N, T) where the person was seen.
        pixels: (N, T, 25, 2) undistorted pixels.
        confidence: (N, T, 25), 0 where not valid.
        landmarks: (N, T, 25, 3) metres of an average body, camera axes, any origin.
        size: (N, T) extent of the person in pixels.
    """

    seconds: Array
    times: Array
    valid: NDArray[np.bool_]
    pixels: Array
    confidence: Array
    landmarks: Array
    size: Array


def gather_evidence(modalities: Modalities, camera: Camera) -> Evidence:
    """Stack the tracks, undistort their pixels and turn their landmarks into the camera's axes."""
    tracks = modalities.tracks
    pixels = camera.undistort(np.stack([t.keypoints for t in tracks]).astype(float))
    confidence = _finite(np.stack([t.confidence for t in tracks]))
    valid = np.stack([t.valid for t in tracks])
    confidence = np.where(valid[..., None] & np.isfinite(pixels).all(-1), np.clip(confidence, 0, 1), 0)
    pixels = _fill_missing(pixels)
    landmarks = expect_shallow(_finite(np.stack([t.landmarks for t in tracks])), regressed_frames(tracks))
    return Evidence(
        seconds=np.diff(modalities.times),
        times=modalities.times,
        valid=valid,
        pixels=pixels,
        confidence=confidence,
        landmarks=turn_to_camera(landmarks, pixels, camera),
        size=_person_sizes(pixels, confidence, valid),
    )


def _finite(values: NDArray) -> Array:
    """Zero for what is no number."""
    return np.nan_to_num(values.astype(float), nan=0.0, posinf=0.0, neginf=0.0)


def _fill_missing(pixels: Array) -> Array:
    """Pixels (..., 25, 2) that are no numbers move to the middle of the others, where they turn nothing."""
    known = np.isfinite(pixels).all(axis=-1, keepdims=True)
    finite = np.where(known, pixels, 0)
    middle = finite.sum(axis=-2, keepdims=True) / np.maximum(known.sum(axis=-2, keepdims=True), 1)
    return np.where(known, pixels, middle)


def regressed_frames(tracks: Sequence[Track]) -> NDArray[np.bool_]:
    """(N, T) where the landmarks are those of a body in a regressed pose."""
    return np.stack([np.zeros_like(t.valid) if t.regressed is None else t.regressed for t in tracks])


def expect_shallow(landmarks: Array, regressed: NDArray[np.bool_]) -> Array:
    """Landmarks as they are to be expected, the depths of points seen one by one drawn towards the body's axis.

    A network's depth within a body is wrong by about 5 cm, and every such error, to the front or to the back, makes a
    limb look shorter in the picture than it is. Taken at its word it puts people 3 to 4 % too near. The axis keeps its
    lean: seen from above, the head of somebody upright is nearer than the feet. A body in a regressed pose has limbs of
    their own length, so that nothing of this holds for it.

    Args:
        landmarks: (..., T, 25, 3).
        regressed: (..., T) where they stay as they are.
    """
    centred = landmarks - landmarks.mean(axis=-2, keepdims=True)
    down, depth = centred[..., 1], centred[..., 2]
    axis = (depth * down).sum((-2, -1)) / np.maximum((down**2).sum((-2, -1)), 1e-9)
    off_axis = depth - axis[..., None, None] * down
    shallow = landmarks - (1 - _LANDMARK_DEPTH) * off_axis[..., None] * (0.0, 0.0, 1.0)
    return np.where(regressed[..., None, None], landmarks, shallow)


def turn_to_camera(landmarks: Array, pixels: Array, camera: Camera) -> Array:
    """Landmarks are seen along the person's own viewing ray: turn that ray's frame into the camera's.

    A crop network knows nothing of where its crop lies; near the border of a wide picture the difference is 30 degrees.

    Args:
        landmarks: (..., 25, 3) with z along the ray to the person.
        pixels: (..., 25, 2) undistorted pixels of the same points.
        camera: intrinsics.
    """
    centre = (pixels.mean(axis=-2) - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    ray = np.concatenate([centre, np.ones((*centre.shape[:-1], 1))], axis=-1)
    turn = align_vectors(np.broadcast_to([0.0, 0.0, 1.0], ray.shape), ray)
    return landmarks @ np.swapaxes(turn, -1, -2)


def _person_sizes(pixels: Array, confidence: Array, valid: NDArray[np.bool_]) -> Array:
    """Longer side of the confident keypoints' box, the clip's median where a person is not seen."""
    seen = (confidence > 0.3)[..., None]
    extent = np.max(np.where(seen, pixels, -np.inf), axis=2) - np.min(np.where(seen, pixels, np.inf), axis=2)
    size = np.max(np.where(np.isfinite(extent), extent, 0), axis=-1)
    for person in range(len(size)):
        known = valid[person] & (size[person] > 0)
        middle = np.median(size[person][known]) if known.any() else _MIN_SIZE_PX
        # A crouch or a cut-off body must not make its pixels count more: no frame is smaller than 70 % of the median.
        size[person] = np.clip(np.where(known, size[person], middle), 0.7 * middle, None)
    return np.maximum(size, _MIN_SIZE_PX)
