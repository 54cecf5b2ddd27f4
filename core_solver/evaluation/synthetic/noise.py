"""How real networks err, in numbers, and random signals of that kind."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NoiseLevels:
    """Errors of the modalities. A person's size is the longer side of the box around the keypoints."""

    keypoint: float = 0.012
    """Standard deviation of a seen 2D keypoint along each axis, in person sizes."""
    keypoint_seconds: float = 0.15
    """Over which that error forgets itself."""
    hidden_factor: float = 2.5
    """By which the error of a hidden keypoint is larger."""
    outlier_share: float = 0.02
    """Of seen keypoints that lie somewhere else."""
    outlier_size: float = 0.12
    """Mean distance of an outlier, in person sizes."""
    outlier_seconds: float = 0.12
    """Mean duration of an outlier."""
    confidence: tuple[float, float, float, float] = (0.85, 0.65, 0.35, 0.05)
    """Mean confidence of keypoints seen, behind the own body, behind others, outside the picture."""
    confidence_spread: float = 0.08
    """Standard deviation of a confidence."""
    pose_degrees: float = 9.0
    """Standard deviation of the angle of a joint in the pose a regressor sees, about each axis."""
    root_degrees: float = 6.0
    """The same of the whole body."""
    pose_seconds: float = 0.4
    """Over which the error of the pose forgets itself."""
    dropouts_per_second: float = 0.15
    """How often a person who is in plain sight is lost."""
    dropout_seconds: float = 0.15
    """Mean duration of that."""
    least_visible: float = 0.2
    """Share of a body that must be seen for the person to be found."""
    mask_cells: float = 0.8
    """Standard deviation by which the outline of a mask is displaced, in cells of the label grid."""
    disparity_scale: float = 0.03
    """Standard deviation of the scale of a frame's disparity."""
    disparity_shift: float = 0.02
    """The same of its shift, in ranges of the picture's disparity."""
    disparity_wave: float = 0.03
    """Standard deviation of the smooth error field, in ranges."""
    disparity_person: float = 0.03
    """Standard deviation by which a whole person is too near or too far, in ranges."""
    disparity_seconds: float = 0.5
    """Over which the errors of disparity forget themselves."""
    disparity_blur: float = 0.006
    """Standard deviation of the blur of edges, in lengths of the picture."""

    def times(self, factor: float) -> "NoiseLevels":
        """The same kinds of errors, larger by a factor; confidences and durations stay."""
        grown = {
            name: factor * getattr(self, name)
            for name in (
                "keypoint", "outlier_share", "pose_degrees", "root_degrees", "dropouts_per_second", "mask_cells",
                "disparity_scale", "disparity_shift", "disparity_wave", "disparity_person",
            )
        }  # fmt: skip
        return NoiseLevels(**{**vars(self), **grown})


def drifting(rng: np.random.Generator, times: Array, shape: tuple[int, ...], seconds: float) -> Array:
    """Unit Gaussian signals (T, *shape) that forget themselves exponentially over `seconds`."""
    fresh = rng.normal(size=(len(times), *shape))
    keep = np.exp(-np.diff(times) / seconds)
    for t, share in enumerate(keep, start=1):
        fresh[t] = share * fresh[t - 1] + np.sqrt(1 - share**2) * fresh[t]
    return fresh


def episodes(
    rng: np.random.Generator, times: Array, shape: tuple[int, ...], share: float, seconds: float
) -> NDArray[np.bool_]:
    """States (T, *shape) that are on for `share` of the time, for `seconds` on average each time."""
    on = np.zeros((len(times), *shape), bool)
    on[0] = rng.random(shape) < share
    for t, step in enumerate(np.diff(times), start=1):
        # A two-state chain with these two rates is on for `share` of the time.
        ends = 1 - np.exp(-step / seconds)
        starts = min(ends * share / max(1 - share, 1e-6), 1.0)
        draw = rng.random(shape)
        on[t] = np.where(on[t - 1], draw >= ends, draw < starts)
    return on


def waves(rng: np.random.Generator, size: tuple[int, int], knots: int) -> NDArray[np.float32]:
    """A smooth random field (height, width) of about unit variance with `knots` bumps along the longer side."""
    width, height = size
    longer = max(width, height)
    coarse = (max(2, round(knots * height / longer)) + 1, max(2, round(knots * width / longer)) + 1)
    return waves_between(rng.normal(size=coarse).astype(np.float32), size)


def waves_between(knots: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Smooth interpolation (height, width) of values at knots; cubic, which keeps about 0.8 of their spread."""
    return cv2.resize(knots, size, interpolation=cv2.INTER_CUBIC) / np.float32(0.8)
