"""The one-euro filter (Casiez, Roussel, Vogel 2012) over a clip of points."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def one_euro(
    values: Array, times: Array, *, min_cutoff_hz: float = 2.5, beta: float = 1.5, speed_cutoff_hz: float = 1.0
) -> Array:
    """Low-pass whose cutoff rises with speed: still points stay still, fast ones are not delayed.

    The filter takes the time BETWEEN frames; with absolute times it would smooth less and less along a clip.

    Args:
        values: (T, ...) metres.
        times: (T,) seconds, increasing.
        min_cutoff_hz: cutoff at rest.
        beta: cutoff gained for each metre a second.
        speed_cutoff_hz: cutoff of the speed estimate.

    Returns:
        (T, ...) filtered values.
    """
    filtered = np.array(values, float)
    speed = np.zeros(filtered.shape[1:])
    for t in range(1, len(filtered)):
        dt = times[t] - times[t - 1]
        raw_speed = (values[t] - values[t - 1]) / dt
        speed = speed + _smoothing(speed_cutoff_hz, dt) * (raw_speed - speed)
        magnitude = np.linalg.norm(speed, axis=-1, keepdims=True)
        gain = _smoothing(min_cutoff_hz + beta * magnitude, dt)
        filtered[t] = filtered[t - 1] + gain * (values[t] - filtered[t - 1])
    return filtered


def one_euro_zero_phase(values: Array, times: Array, *, min_cutoff_hz: float = 3.0, beta: float = 2.0) -> Array:
    """The filter run both ways, one after the other, which cancels its delay and damps twice.

    Speed raises the cutoff, so the order matters a little: the mean of both orders is blind to the direction of time.
    Arguments as in `one_euro`.
    """

    def forwards(points: Array) -> Array:
        return one_euro(points, times, min_cutoff_hz=min_cutoff_hz, beta=beta)

    def backwards(points: Array) -> Array:
        return one_euro(points[::-1], -times[::-1], min_cutoff_hz=min_cutoff_hz, beta=beta)[::-1]

    return (backwards(forwards(values)) + forwards(backwards(values))) / 2


def _smoothing(cutoff_hz: float | Array, dt: float) -> Array:
    """Gain of a first-order low-pass sampled every `dt` seconds."""
    return np.asarray(1 / (1 + 1 / (2 * np.pi * np.asarray(cutoff_hz) * dt)))
