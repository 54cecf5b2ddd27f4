"""How real networks err, in numbers, and random signals of that kind."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# How these numbers were found: tracks and disparity of four static clips (two views of two people in a laboratory with
# triangulated joints, 60 fps; a street with eleven walkers, 10 fps; a runner outdoors, 30 fps) by the default networks
# after tracking. Against triangulated joints: 2D and 3D keypoints, confidences, a person's disparity beside that of the
# laboratory's known floor. Against the clip's own median picture, where it is background throughout: everything else
# about disparity. Only such totals entered; where clips differ, the number lies between them. An error is split into
# its median over a clip (a bias) and the rest, whose autocorrelation gives its duration. Triangulation itself errs by
# 0.012 person sizes, which mostly hides in the bias: keypoint errors are between the bounds that follow when all or
# nothing of it is subtracted. Outlines of masks could only be compared from frame to frame: 0.1 to 0.25 cells change
# per cell of outline; that they are wrong by 0.7 cells is an assumption.


@dataclass(frozen=True)
class NoiseLevels:
    """Errors of the modalities: standard deviations where nothing else is said.

    A person's size is the longer side of the box around the keypoints, a range is the difference between the nearest
    and the farthest disparity of a picture.
    """

    keypoint_bias: float = 0.008
    """Of a seen 2D keypoint's mean place along each axis, in person sizes (0.008 to 0.017 measured)."""
    keypoint: float = 0.009
    """Of a seen 2D keypoint about that, in person sizes (0.006 to 0.012)."""
    keypoint_seconds: float = 0.10
    """Over which that error forgets itself."""
    hidden_factor: float = 2.5
    """By which errors of hidden keypoints are larger: those of confidence 0.2 to 0.6 against those above 0.8."""
    outlier_share: float = 0.035
    """Of keypoints that lie beyond five deviations (0.03 to 0.08)."""
    outlier_size: float = 0.11
    """Mean distance of those, in person sizes (0.05 to 0.22)."""
    outlier_seconds: float = 0.12
    """Mean duration of an outlier."""
    sure: tuple[float, float, float, float] = (3.9, 0.9, -0.4, -2.6)
    """Log-odds of the median confidence of keypoints seen, behind the own body, behind others, outside the picture
    (together: median 0.98, a quarter below 0.88, a twentieth below 0.37)."""
    sure_spread: float = 1.5
    """Of those log-odds."""
    landmark_bias_degrees: float = 7.0
    """Of the mean angle about each axis of a joint in the pose that a regressor sees."""
    landmark_degrees: float = 4.0
    """About that mean (together they give 3D keypoints that are wrong, root and scale aligned, by what was measured:
    70 mm in the mean over a clip and 30 to 45 mm along each axis about it)."""
    root_bias_degrees: float = 4.0
    """Of the mean turn of the whole body about each axis (1 to 14)."""
    root_degrees: float = 4.0
    """About that mean (3 to 8; one person seen from behind flips by 20)."""
    landmark_seconds: float = 0.11
    """Over which the error of the pose forgets itself."""
    dropouts_per_second: float = 0.2
    """How often a person who is in plain sight is lost (0 to 0.6)."""
    dropout_seconds: float = 0.2
    """Mean duration of that (0.03 to 0.6)."""
    least_visible: float = 0.2
    """Share of a body that must be seen for the person to be found."""
    mask_cells: float = 0.7
    """By which the outline of a mask is displaced along each axis, in cells of the label grid."""
    mask_seconds: float = 0.7
    """Over which that changes."""
    disparity_scale: float = 0.014
    """Of the scale of one frame's normalised disparity (0.009 to 0.028)."""
    disparity_shift: float = 0.011
    """Of its shift, in ranges (0.005 to 0.016)."""
    disparity_affine_seconds: float = 0.3
    """Over which both forget themselves."""
    disparity_relief: float = 0.045
    """Of the smooth error that stays, in ranges: of a known bare floor (0.045 to 0.06)."""
    disparity_wave: float = 0.013
    """Of the smooth error that changes, in ranges (0.007 to 0.035)."""
    disparity_wave_seconds: float = 0.2
    """Over which that forgets itself."""
    disparity_grain: float = 0.005
    """Of the error of single pixels and small patches, in ranges (0.002 to 0.007)."""
    disparity_person_bias: float = 0.08
    """By which a person is nearer or farther than the floor says, on the mean over a clip, in ranges."""
    disparity_person: float = 0.05
    """The same about that mean (0.03 to 0.08)."""
    disparity_person_seconds: float = 0.15
    """Over which that forgets itself."""
    disparity_blur: float = 0.003
    """Of the Gaussian that blurs edges, in lengths of the picture (before edges are sharpened, as perception does)."""

    def times(self, factor: float) -> "NoiseLevels":
        """The same kinds of errors, larger by a factor; durations, confidences and blur stay."""
        return replace(self, **{name: factor * getattr(self, name) for name in _GROWING})


_GROWING = (
    "keypoint_bias", "keypoint", "outlier_share", "landmark_bias_degrees", "landmark_degrees", "root_bias_degrees",
    "root_degrees", "dropouts_per_second", "mask_cells", "disparity_scale", "disparity_shift", "disparity_relief",
    "disparity_wave", "disparity_grain", "disparity_person_bias", "disparity_person",
)  # fmt: skip

# Cubic interpolation between independent knots of unit variance leaves this variance on average.
_CUBIC_VARIANCE = 0.74


def drifting(rng: np.random.Generator, times: Array, shape: tuple[int, ...], seconds: float) -> Array:
    """Unit Gaussian signals (T, *shape) that forget themselves exponentially over `seconds`."""
    signal = rng.normal(size=(len(times), *shape))
    for t, keep in enumerate(np.exp(-np.diff(times) / seconds), start=1):
        signal[t] = keep * signal[t - 1] + np.sqrt(1 - keep**2) * signal[t]
    return signal


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


def knot_shape(size: tuple[int, int], knots: int) -> tuple[int, int]:
    """(rows, columns) of knots over a picture of (width, height), `knots` along its longer side."""
    width, height = size
    longer = max(width, height)
    return max(2, round(knots * height / longer)), max(2, round(knots * width / longer))


def smooth_field(knots: Array, size: tuple[int, int]) -> NDArray[np.float32]:
    """A smooth picture (height, width) through independent (rows, columns) knots, as large as they on average."""
    field = cv2.resize(knots.astype(np.float32), size, interpolation=cv2.INTER_CUBIC)
    return np.asarray(field, np.float32) / np.float32(np.sqrt(_CUBIC_VARIANCE))
