"""Tracks: one person over the whole clip, indexed by the take's frames."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

BACKGROUND = 0
UNCLAIMED = 255  # a person's pixel that belongs to no track: neither anybody's evidence nor background


@dataclass(frozen=True)
class Track:
    """One person over T frames.

    Attributes:
        id: positive, stable; also the person's value in `Modalities.labels`.
        valid: (T,) bool, True where the person was seen in that frame; other frames carry no evidence.
        keypoints: (T, 25, 2) pixels of the distorted footage; interpolated where not valid.
        confidence: (T, 25) in [0, 1]; 0 where not valid.
        landmarks: (T, 25, 3) metres of an average body, camera axes, origin mid-hips; interpolated where not valid.
        score: mean detection score over the valid frames.
        name: given by the user; empty for the default one.
        regressed: (T,) bool, True where the landmarks are those of a body in a regressed pose, whose depths are a
            body's, and not points that a network saw one by one; None for nowhere.
    """

    id: int
    valid: NDArray[np.bool_]
    keypoints: Floats
    confidence: Floats
    landmarks: Floats
    score: float
    name: str = ""
    regressed: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class DroppedTrack:
    """Somebody who is not solved, because they were seen too briefly or others better.

    Attributes:
        first_frame: take frame of the first sight.
        frame_count: frames in which the person was seen.
        position: (2,) mean pixel of the box centre.
        needed: frames in which a person must be seen to be solved.
    """

    first_frame: int
    frame_count: int
    position: tuple[float, float]
    needed: int


@dataclass(frozen=True)
class Modalities:
    """The solver's whole input, one row per frame of the take.

    Attributes:
        times: (T,) seconds.
        frames: (T,) number of the frame in the video.
        image_size: (width, height) pixels of the footage.
        tracks: the people.
        labels: (T, h, w) uint8 on a grid laid over the whole image: BACKGROUND, a track's id, or UNCLAIMED.
        disparity: (T, hd, wd) float16 in [0, 1], near = large, on a grid laid over the whole image; None without.
        dropped: people left out, for the summary.
        edges: (L, 5) straight edges of the background: both ends in pixels of the distorted footage (u, v, u, v) and
            how much each counts; None where nobody looked.
    """

    times: NDArray[np.float64]
    frames: NDArray[np.int64]
    image_size: tuple[int, int]
    tracks: tuple[Track, ...]
    labels: NDArray[np.uint8]
    disparity: NDArray[np.float16] | None
    dropped: tuple[DroppedTrack, ...] = ()
    edges: Floats | None = None
