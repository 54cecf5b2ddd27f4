# SPDX-License-Identifier: GPL-3.0-or-later
"""Curves over time: filters without lag, spans of frames, ramps."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def low_pass(values: Array, rate: float, cutoff: float) -> Array:
    """Curves without their fast part, neither earlier nor later than before.

    A Gaussian that halves the power at the cut-off; straight lines pass unchanged up to both ends.

    Args:
        values: (T, ...).
        rate: frames per second.
        cutoff: Hz.
    """
    count = len(values)
    # Seen as time, the Gaussian's deviation in frames; what is farther away than six of them counts nothing.
    deviation = np.sqrt(np.log(2)) / (2 * np.pi * cutoff) * rate
    margin = int(np.ceil(6 * deviation)) + 1
    flat = values.reshape(count, -1)
    # Turned about the end point, as a curve that goes on with the slope it ends with.
    padded = np.pad(flat, [(margin, margin), (0, 0)], "reflect", reflect_type="odd")
    # Sampled in time, so that a cut-off above what the frame rate can show changes nothing at all.
    away = np.minimum(np.arange(len(padded)), len(padded) - np.arange(len(padded)))
    kernel = np.exp(-0.5 * (away / deviation) ** 2)
    gain = np.fft.rfft(kernel / kernel.sum()).real
    smooth = np.fft.irfft(np.fft.rfft(padded, axis=0) * gain[:, None], len(padded), axis=0)
    return smooth[margin : margin + count].reshape(values.shape)


def known_low_pass(values: Array, known: Flags, rate: float, cutoff: float) -> Array:
    """The slow part of curves that are known in some frames only; straight lines lead over the others.

    Args:
        values: (T, C).
        known: (T,) which frames count.
        rate: frames per second.
        cutoff: Hz.

    Returns:
        (T, C); zeros where no frame is known.
    """
    frames = np.flatnonzero(known)
    if not len(frames):
        return np.zeros_like(values)
    lines = [np.interp(np.arange(len(values)), frames, column[frames]) for column in values.T]
    return low_pass(np.stack(lines, axis=1), rate, cutoff)


def raised(values: Array, radius: int) -> Array:
    """(T,) a smooth curve that is nowhere below `values`, and equal to them where they do not change.

    The largest value within the radius, then the mean over the radius: each mean is of numbers not below its middle.
    """
    window = 2 * radius + 1
    padded = np.pad(values, 2 * radius, "edge")
    highest = np.lib.stride_tricks.sliding_window_view(padded, window).max(axis=-1)
    hann = np.hanning(window + 2)[1:-1]
    return np.convolve(highest, hann / hann.sum(), "valid")


def spans(flags: Flags) -> list[tuple[int, int]]:
    """Runs of true: first frame, and the frame after the last."""
    edges = np.diff(flags.astype(int), prepend=0, append=0)
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return list(zip(starts.tolist(), ends.tolist(), strict=True))


def closed(flags: Flags, shortest: float) -> Flags:
    """(T,) flags without gaps of fewer frames than `shortest`; those at the ends stay."""
    whole = flags.copy()
    for start, end in spans(~flags):
        if end - start < shortest and start > 0 and end < len(flags):
            whole[start:end] = True
    return whole


def ramp(share: Array) -> Array:
    """From 0 at 0 to 1 at 1 with level ends; constant outside."""
    share = np.clip(share, 0.0, 1.0)
    return share * share * (3 - 2 * share)
