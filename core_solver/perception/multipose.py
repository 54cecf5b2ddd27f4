"""People in a picture with MoveNet MultiPose, near and far.

The network finds at most six people and only those of a certain size: at 256 pixels it loses the far ones, at 768 the
near ones. So it looks at the whole picture at two sizes, where there are many people or small ones also at
overlapping tiles, and where it is in doubt from close by; the finds are merged.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from core_solver.errors import ModelError
from core_solver.perception.onnx_session import open_session

Floats = NDArray[np.float32]
Image = NDArray[np.uint8]

COCO_COUNT = 17
_STRIDE = 32  # the network's input sides are multiples of this
_WHOLE_SIZES = (256, 512)  # pixels of the longer side: the first for near people, the second for farther ones
_TILE_SIZE = 448
_DOUBTFUL, _SURE = 0.1, 0.3  # person scores between which someone may be there
_WINDOW_SIDE = 2.5  # of a doubtful person's size
_WINDOW_SIZE = 320
_MOST_WINDOWS = 4
_CROWD = 5  # people; the network names at most six
_SMALL = 0.245  # of the picture's longer side

# COCO's own spreads of the 17 keypoints, relative to the square root of a person's area.
_SPREAD = 2 * np.array(
    [.026, .025, .025, .035, .035, .079, .079, .072, .072, .062, .062, .107, .107, .087, .087, .089, .089], np.float32
)  # fmt: skip
_SAME_PERSON = 0.5  # keypoint similarity above which two finds are one person
_SAME_BOX = 0.6  # box overlap for the same, where too few keypoints are comparable
_COMPARABLE = 4  # keypoints
_SEEN = 0.2  # keypoint score


@dataclass(frozen=True)
class Pose:
    """One person as MoveNet sees it.

    Attributes:
        score: in [0, 1].
        box: (4,) left, top, right, bottom in pixels.
        keypoints: (17, 2) pixels, COCO's order.
        confidence: (17,) in [0, 1].
    """

    score: float
    box: Floats
    keypoints: Floats
    confidence: Floats


@dataclass(frozen=True)
class View:
    """A rectangle of the picture, shown to the network with its longer side at `size` pixels."""

    left: int
    top: int
    width: int
    height: int
    size: int


class MultiPose:
    """MoveNet MultiPose as an ONNX file; the input may have fixed or free height and width."""

    def __init__(self, path: Path, *, least_score: float = 0.2) -> None:
        """Load the network.

        Args:
            path: ONNX file with input (1, h, w, 3) int32 RGB and output (1, 6, 56).
            least_score: finds below are dropped; lamp posts and bushes reach 0.2, people half hidden 0.25.

        Raises:
            ModelError: unreadable, or another kind of network.
        """
        self.path = path
        self._session = open_session(path)
        self._input = self._session.get_inputs()[0].name
        self._fixed_size = _fixed_size(path, self._session)
        self._least_score = least_score

    def __call__(self, image: Image) -> tuple[Pose, ...]:
        """The people in a (H, W, 3) BGR picture, surest first."""
        height, width = image.shape[:2]
        found = [p for size in _WHOLE_SIZES for p in self._look(image, View(0, 0, width, height, size))]
        if wants_closer_look(self._sure(found), max(width, height)):
            found += [p for tile in picture_tiles(width, height) for p in self._look(image, tile)]
        found += [
            p for window in doubtful_windows(merge_poses(found), width, height) for p in self._look(image, window)
        ]
        return merge_poses(list(self._sure(found)))

    def _sure(self, found: list[Pose]) -> tuple[Pose, ...]:
        return tuple(pose for pose in merge_poses(found) if pose.score >= self._least_score)

    def _look(self, image: Image, view: View) -> list[Pose]:
        part = image[view.top : view.top + view.height, view.left : view.left + view.width]
        tensor, scale = letterbox(part, view.size, self._fixed_size)
        rows = np.asarray(self._session.run(None, {self._input: tensor})[0])[0]
        poses = decode_poses(rows, tensor.shape[1:3], scale, (view.left, view.top))
        whole_height, whole_width = image.shape[:2]
        return [p for p in poses if p.score >= _DOUBTFUL and not _is_cut(p.box, view, whole_width, whole_height)]


def wants_closer_look(people: tuple[Pose, ...], picture_size: int) -> bool:
    """Whether there may be more people than the network can name at once, or too small for it to see them all."""
    return len(people) >= _CROWD or min(map(person_size, people), default=0.0) < _SMALL * picture_size


def picture_tiles(width: int, height: int) -> tuple[View, ...]:
    """Squares of 0.6 of the longer side, overlapping so that a far person is whole in at least one."""
    side = round(0.6 * max(width, height))
    across, down = min(side, width), min(side, height)
    columns = np.linspace(0, width - across, 1 if across == width else 2)
    rows = np.linspace(0, height - down, 1 if down == height else 2)
    return tuple(View(int(x), int(y), across, down, _TILE_SIZE) for y in rows for x in columns)


def doubtful_windows(people: tuple[Pose, ...], width: int, height: int) -> tuple[View, ...]:
    """Windows around finds of low score, surest first, for a look from close by; neighbours share one."""
    windows: list[View] = []
    for pose in people:
        side = round(_WINDOW_SIDE * person_size(pose))
        if pose.score >= _SURE or side > 0.6 * max(width, height) or any(_holds(w, pose.box) for w in windows):
            continue
        across, down = min(side, width), min(side, height)
        x, y = pose.box.reshape(2, 2).mean(axis=0)
        left, top = (int(np.clip(c - s / 2, 0, end - s)) for c, s, end in ((x, across, width), (y, down, height)))
        windows.append(View(left, top, across, down, _WINDOW_SIZE))
    return tuple(windows[:_MOST_WINDOWS])


def letterbox(part: Image, size: int, fixed: tuple[int, int] | None) -> tuple[NDArray[np.int32], float]:
    """Scale a BGR picture into the network's input, padded with black at the right and bottom.

    Args:
        part: (h, w, 3).
        size: wanted length of the longer side; ignored for a network of fixed size.
        fixed: (height, width) of such a network.

    Returns:
        (1, h', w', 3) int32 RGB, and input pixels per picture pixel.
    """
    height, width = part.shape[:2]
    scale = size / max(height, width) if fixed is None else min(fixed[0] / height, fixed[1] / width)
    small_w, small_h = max(round(width * scale), 1), max(round(height * scale), 1)
    small = cv2.resize(part, (small_w, small_h), interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    rows, columns = fixed or (-(-small_h // _STRIDE) * _STRIDE, -(-small_w // _STRIDE) * _STRIDE)
    tensor = np.zeros((1, rows, columns, 3), np.int32)
    tensor[0, :small_h, :small_w] = small[..., ::-1]
    return tensor, scale


def decode_poses(
    rows: Floats, input_size: tuple[int, ...], scale: float, offset: tuple[int, int] = (0, 0)
) -> list[Pose]:
    """Poses in picture pixels from the network's (n, 56) output, normalised to an input of (height, width)."""
    height, width = input_size
    to_pixels = (np.array([width, height]) / scale).astype(np.float32)
    shift = np.array(offset, np.float32)
    poses = []
    for row in rows.astype(np.float32):
        y_x_score = row[:51].reshape(COCO_COUNT, 3)
        top, left, bottom, right = row[51:55]
        keypoints = y_x_score[:, 1::-1] * to_pixels + shift
        box = (np.array([[left, top], [right, bottom]]) * to_pixels + shift).astype(np.float32).ravel()
        poses.append(Pose(float(row[55]), box, keypoints, y_x_score[:, 2].copy()))
    return poses


def merge_poses(poses: list[Pose]) -> tuple[Pose, ...]:
    """One pose a person: of several finds of the same person the surest is kept."""
    kept: list[Pose] = []
    for pose in sorted(poses, key=_quality, reverse=True):
        if not any(same_person(pose, other) for other in kept):
            kept.append(pose)
    return tuple(kept)


def same_person(a: Pose, b: Pose) -> bool:
    """Whether two finds are one person, by COCO's keypoint similarity over the keypoints that both have seen."""
    both = (a.confidence > _SEEN) & (b.confidence > _SEEN)
    if both.sum() < _COMPARABLE:
        return box_overlap(a.box, b.box) > _SAME_BOX
    area = max(_area(a.box), _area(b.box), 1.0)
    squared = np.sum((a.keypoints[both] - b.keypoints[both]) ** 2, axis=1)
    return float(np.mean(np.exp(-squared / (2 * area * _SPREAD[both] ** 2)))) > _SAME_PERSON


def person_size(pose: Pose) -> float:
    """Longer side of the person's box, pixels."""
    return max(float(np.max(pose.box[2:] - pose.box[:2])), 1.0)


def box_overlap(a: Floats, b: Floats) -> float:
    """Intersection over union of two boxes (4,) left, top, right, bottom."""
    size = np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0)
    intersection = float(size[0] * size[1])
    return intersection / max(_area(a) + _area(b) - intersection, 1e-6)


def _quality(pose: Pose) -> float:
    return pose.score * float(pose.confidence.mean())


def _area(box: Floats) -> float:
    return float(max(box[2] - box[0], 0) * max(box[3] - box[1], 0))


def _holds(view: View, box: Floats) -> bool:
    inside = (box[:2] >= (view.left, view.top)) & (box[2:] <= (view.left + view.width, view.top + view.height))
    return bool(inside.all())


def _is_cut(box: Floats, view: View, width: int, height: int) -> bool:
    """Whether a find touches a border of its tile inside the picture: half a person, who is whole in another view."""
    margin = 0.02 * max(view.width, view.height)
    left, top, right, bottom = box
    return bool(
        (view.left > 0 and left < view.left + margin)
        or (view.top > 0 and top < view.top + margin)
        or (view.left + view.width < width and right > view.left + view.width - margin)
        or (view.top + view.height < height and bottom > view.top + view.height - margin)
    )


def _fixed_size(path: Path, session: onnxruntime.InferenceSession) -> tuple[int, int] | None:
    inputs, outputs = session.get_inputs(), session.get_outputs()
    shape = inputs[0].shape
    if len(inputs) != 1 or len(shape) != 4 or shape[3] != 3 or list(outputs[0].shape or [])[-1:] != [56]:
        raise ModelError(f"{path.name} is not MoveNet MultiPose: it must turn (1, h, w, 3) into (1, 6, 56)")
    return (shape[1], shape[2]) if isinstance(shape[1], int) and isinstance(shape[2], int) else None
