"""A camera that shakes a little becomes one that stands still: what was seen is moved to where the first frame saw it.

Networks look at the raw frames, so that what they found stays valid; their findings are moved before tracking. Each
frame is registered by corners of the background. A camera that only turns moves its picture by a homography, whatever
the scene's depth; one that also shifts does not, and then the residual tells.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.footage import between_centres, move_box, move_picture, move_points, shifted
from core_solver.perception.observations import CroppedMask, Detection, FrameObservations
from core_solver.video import (
    ENOUGH_CORNERS,
    MOTION_LONG_SIDE,
    CameraMotion,
    Image,
    VideoClip,
    background_corners,
    follow_corners,
    small_grey,
)

Array = NDArray[np.float64]

MODELS = ("similarity", "affine", "homography")

_STEADY_SHARE = 0.0007  # of the diagonal: less is not worth resampling anything
_LARGEST_SHARE = 0.04  # beyond that too little of the first picture is left in the others
_RESIDUAL_SHARE = 0.001  # of the diagonal, beyond the best a tripod gives: more means that the camera also travels
_OUTLIER_PX = 2.0  # of the small picture
_MOST_LOST = 0.1  # share of the frames
_BETTER = 0.95  # a richer model must predict corners it has not seen this much better
_TRIAL_EVERY = 4  # frames in which the models compete


@dataclass(frozen=True)
class Shake:
    """How a camera shook, measured on the background.

    Attributes:
        maps: (T, 3, 3) homographies from each frame's pixels to the first frame's.
        model: the kind of map that predicts unseen corners best, one of MODELS.
        size_px: 90th percentile of how far the picture's corners moved, pixels.
        residual_px: median distance of background corners from the first frame's after compensation, pixels.
        lost_frames: share of frames whose map is interpolated, for their background was not found.
        diagonal_px: of the picture.
    """

    maps: Array
    model: str
    size_px: float
    residual_px: float
    lost_frames: float
    diagonal_px: float

    @property
    def is_compensated(self) -> bool:
        """Whether after compensation the camera may be called static."""
        return (
            self.size_px <= _LARGEST_SHARE * self.diagonal_px
            and self.residual_px <= _RESIDUAL_SHARE * self.diagonal_px
            and self.lost_frames <= _MOST_LOST
        )

    def describe(self) -> str:
        """A sentence for the user."""
        return (
            f"The camera shakes by {self.size_px:.1f} pixels: compensated by a {self.model} of the background, "
            f"{self.residual_px:.1f} pixels are left. The take's camera is that of the first frame."
        )

    def steady_picture(self, position: int, picture: Image) -> Image:
        """The (H, W, 3) picture of a frame as the first frame's camera would have seen it."""
        return move_picture(self.maps[position], picture)


def is_worth_measuring(motion: CameraMotion) -> bool:
    """Whether a camera's motion is more than a tripod's and not hopeless."""
    drift = motion.drift_px / motion.diagonal_px
    return _STEADY_SHARE < drift <= _LARGEST_SHARE and motion.lost_frames == 0


def measure_shake(clip: VideoClip, observations: Sequence[FrameObservations]) -> Shake | None:
    """Register every frame of a clip with the first one.

    Args:
        clip: the video, decoded once more.
        observations: one for each frame of the clip; people are no background.

    Returns:
        The motion; None where the first frame shows no background to hold on to.
    """
    pictures = clip.frames()
    first_picture = next(pictures)[1]
    scale = min(1.0, MOTION_LONG_SIDE / max(clip.width, clip.height))
    first = small_grey(first_picture, scale)
    corners = background_corners(first, [d.box for d in observations[0].detections], scale)
    if len(corners) < ENOUGH_CORNERS:
        return None
    follower = _Follower(first, corners)
    for position, (_, picture) in enumerate(pictures, start=1):
        follower.follow(small_grey(picture, scale), is_trial=position % _TRIAL_EVERY == 1)
    model = follower.best_model()
    known = [maps if maps is None else maps[model] for maps in follower.maps]
    to_small = np.diag([scale, scale, 1.0])
    forward = np.linalg.inv(to_small) @ shifted(_interpolated(known), 0.5) @ to_small
    diagonal = float(np.hypot(clip.width, clip.height))
    return Shake(
        maps=_normalised(np.linalg.inv(forward)),
        model=MODELS[model],
        size_px=_size(forward, clip.width, clip.height),
        residual_px=float(np.median(follower.residuals(model))) / scale,
        lost_frames=sum(k is None for k in known) / len(known),
        diagonal_px=diagonal,
    )


def find_shake(clip: VideoClip, observations: Sequence[FrameObservations], motion: CameraMotion) -> Shake | None:
    """The shake of a clip where there is one that can be compensated; None for tripods and for cameras that travel."""
    shake = measure_shake(clip, observations) if is_worth_measuring(motion) else None
    return shake if shake is not None and shake.is_compensated else None


def steady(
    observations: Sequence[FrameObservations], maps: Array, picture: tuple[int, int], labels: tuple[int, int]
) -> list[FrameObservations]:
    """What was seen, where the first frame's camera would have seen it.

    Args:
        observations: one for each frame.
        maps: (T, 3, 3) homographies from the same frames' pixels to the first frame's.
        picture: (width, height) of the footage.
        labels: (width, height) of the grid of the people's masks.
    """
    return [_moved(seen, to_first, picture, labels) for seen, to_first in zip(observations, maps, strict=True)]


class _Follower:
    """Follows the first frame's corners through the others and fits each kind of map to them."""

    def __init__(self, first: Image, corners: NDArray[np.float32]) -> None:
        self._first, self._corners = first, corners
        self._guess = np.eye(3)
        self._trials: list[list[float]] = []
        self._distances: list[list[float]] = []
        self.maps: list[list[Array] | None] = [[np.eye(3)] * len(MODELS)]

    def follow(self, other: Image, *, is_trial: bool) -> None:
        there, good = follow_corners(self._first, other, self._corners, move_points(self._guess, self._corners))
        here, there = self._corners[good], there[good]
        maps = _fit_all(here, there) if len(here) >= max(ENOUGH_CORNERS, 0.1 * len(self._corners)) else None
        self.maps.append(maps)
        if maps is None:
            return
        self._guess = maps[0]
        self._distances.append([_distance(m, here, there) for m in maps])
        halves = _fit_all(here[::2].copy(), there[::2].copy()) if is_trial else None
        if halves is not None:
            self._trials.append([_distance(m, here[1::2], there[1::2]) for m in halves])

    def best_model(self) -> int:
        """The simplest model that no richer one beats clearly on corners it was not fitted to."""
        if not self._trials:
            return 0
        errors = np.median(self._trials, axis=0)
        best = 0
        for richer in range(1, len(MODELS)):
            if errors[richer] < _BETTER * errors[best]:
                best = richer
        return best

    def residuals(self, model: int) -> list[float]:
        """Median distance of the corners in each frame, pixels of the small picture."""
        return [distances[model] for distances in self._distances] or [0.0]


def _fit_all(here: NDArray[np.float32], there: NDArray[np.float32]) -> list[Array] | None:
    """A map of each of MODELS as (3, 3); None where one cannot be fitted."""
    if len(here) < ENOUGH_CORNERS // 2:
        return None
    similarity, _ = cv2.estimateAffinePartial2D(here, there, ransacReprojThreshold=_OUTLIER_PX)
    affine, _ = cv2.estimateAffine2D(here, there, ransacReprojThreshold=_OUTLIER_PX)
    homography, _ = cv2.findHomography(here, there, cv2.RANSAC, _OUTLIER_PX)
    if similarity is None or affine is None or homography is None:
        return None
    last = [[0.0, 0.0, 1.0]]
    return [np.concatenate([similarity, last]), np.concatenate([affine, last]), np.asarray(homography, float)]


def _distance(homography: Array, here: NDArray, there: NDArray) -> float:
    return float(np.median(np.linalg.norm(move_points(homography, here) - there, axis=-1)))


def _interpolated(known: Sequence[Array | None]) -> Array:
    """Maps (T, 3, 3) with gaps filled from both sides; the first is always known."""
    frames = [t for t, k in enumerate(known) if k is not None]
    entries = np.stack([k for k in known if k is not None]).reshape(len(frames), 9)
    filled = [np.interp(range(len(known)), frames, column) for column in entries.T]
    return np.stack(filled, axis=-1).reshape(-1, 3, 3)


def _normalised(maps: Array) -> Array:
    return maps / maps[..., 2:, 2:]


def _size(forward: Array, width: int, height: int) -> float:
    corners = np.array([[0.0, 0.0], [width, 0], [0, height], [width, height]])
    moved = np.stack([move_points(m, corners) for m in forward])
    return float(np.percentile(np.linalg.norm(moved - corners, axis=-1), 90))


def _moved(
    seen: FrameObservations, to_first: Array, picture: tuple[int, int], labels: tuple[int, int]
) -> FrameObservations:
    return FrameObservations(
        seen.frame,
        tuple(_moved_detection(d, to_first, picture, labels) for d in seen.detections),
        None if seen.disparity is None else _moved_disparity(seen.disparity, to_first, picture),
        tuple(_moved_mask(mask, _on_grid(to_first, picture, labels), labels) for mask in seen.unclaimed),
    )


def _moved_detection(
    person: Detection, to_first: Array, picture: tuple[int, int], labels: tuple[int, int]
) -> Detection:
    left, top, right, bottom = person.box.astype(float)
    turn = _turn(to_first, np.array([(left + right) / 2, (top + bottom) / 2]))
    return replace(
        person,
        box=move_box(to_first, person.box).astype(np.float32),
        keypoints=move_points(to_first, person.keypoints.astype(float)).astype(np.float32),
        landmarks=(person.landmarks @ turn.T).astype(np.float32),
        mask=_moved_mask(person.mask, _on_grid(to_first, picture, labels), labels),
    )


def _turn(to_first: Array, place: Array) -> Array:
    """(3, 3) turn about the viewing ray that the map makes at a pixel."""
    step = move_points(to_first, place + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    right, down = step[1] - step[0], step[2] - step[0]
    angle = np.arctan2(right[1] - down[0], right[0] + down[1])
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


def _on_grid(to_first: Array, picture: tuple[int, int], grid: tuple[int, int]) -> Array:
    """The same map between the cell centres of a grid laid over the whole picture, as OpenCV counts them."""
    cells = np.diag([grid[0] / picture[0], grid[1] / picture[1], 1.0])
    return between_centres(cells @ to_first @ np.linalg.inv(cells))


def _moved_mask(mask: CroppedMask, on_grid: Array, labels: tuple[int, int]) -> CroppedMask:
    height, width = mask.values.shape
    if mask.values.size == 0:
        return mask
    corners = np.array([[0, 0], [width, 0], [0, height], [width, height]])
    moved = move_points(on_grid, corners + np.array([mask.left - 0.5, mask.top - 0.5]))
    low = np.clip(np.floor(moved.min(axis=0)), 0, np.array(labels) - 1).astype(int)
    high = np.clip(np.ceil(moved.max(axis=0)) + 1, low + 1, labels).astype(int)
    from_crop = np.array([[1, 0, mask.left], [0, 1, mask.top], [0, 0, 1.0]])
    into_crop = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, 1.0]])
    size = int(high[0] - low[0]), int(high[1] - low[1])
    values = cv2.warpPerspective(mask.values, into_crop @ on_grid @ from_crop, size, flags=cv2.INTER_LINEAR)
    return CroppedMask(int(low[1]), int(low[0]), np.asarray(values, np.uint8).reshape(size[1], size[0]))


def _moved_disparity(disparity: NDArray[np.float16], to_first: Array, picture: tuple[int, int]) -> NDArray[np.float16]:
    """What lies outside the frame is not known."""
    height, width = disparity.shape
    cells = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    source = move_points(np.linalg.inv(_on_grid(to_first, picture, (width, height))), cells)
    x, y = (source[..., axis].astype(np.float32) for axis in (0, 1))
    values = cv2.remap(disparity.astype(np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    outside = np.any((source < -0.5) | (source > np.array([width, height]) - 0.5), axis=-1)
    return np.where(outside, np.nan, values).astype(np.float16)
