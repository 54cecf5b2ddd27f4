"""What perception gives for one frame. Pixels refer to the upright video frame, before any undistortion."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class FrameInfo:
    """One decoded frame's place in the video.

    Attributes:
        index: number in the video, counted from 0.
        time: seconds from the start of the video, exact for variable frame rates.
    """

    index: int
    time: float


@dataclass(frozen=True)
class CroppedMask:
    """A person's mask inside its box, on the grid of the frame's `label_size`.

    Attributes:
        top: first row on the label grid.
        left: first column on the label grid.
        values: (h, w) uint8, probability of the person times 255.
    """

    top: int
    left: int
    values: NDArray[np.uint8]


@dataclass(frozen=True)
class Detection:
    """One person in one frame.

    Attributes:
        score: in [0, 1], how sure the detector is that this is a person.
        box: (4,) left, top, right, bottom in pixels.
        keypoints: (25, 2) pixels, in the order of `body.KEYPOINT_NAMES`.
        confidence: (25,) in [0, 1]; 0 for a keypoint that was not seen.
        landmarks: (25, 3) metres of an average-size body, axes of the camera (x right, y down, z forward as seen along
            the person's own viewing ray), origin at the mid-hips; NaN where nobody has said.
        appearance: (D,) unit vector describing clothes and skin colours.
        mask: where the person is; empty where nobody has said.
        identity: the same number for the same person in all frames, where files given by the user say so; None for
            somebody to be tracked.
        regressed: whether the landmarks are those of a body in a regressed pose (SMPL), and not points that a network
            saw one by one.
    """

    score: float
    box: Floats
    keypoints: Floats
    confidence: Floats
    landmarks: Floats
    appearance: Floats
    mask: CroppedMask
    identity: int | None = None
    regressed: bool = False


@dataclass(frozen=True)
class FrameObservations:
    """Everything seen in one frame.

    Attributes:
        frame: which frame.
        detections: the people, in no order.
        disparity: (h, w) float16 in [0, 1], near = large, relative only, NaN where unknown; None without depth.
        unclaimed: where somebody may be whom none of the masks covers: nobody's evidence and not background either.
    """

    frame: FrameInfo
    detections: tuple[Detection, ...]
    disparity: NDArray[np.float16] | None
    unclaimed: tuple[CroppedMask, ...] = ()
