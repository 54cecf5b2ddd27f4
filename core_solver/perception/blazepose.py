"""33 landmarks in the picture and in metres, and a mask, of one person: BlazePose on an upright crop.

The network wants the person upright, mid-hips in the centre, and large. Its answer sometimes jumps with the crop: above
all a person seen from behind may be taken for one seen from the front. MoveNet, which sees the whole picture, is the
judge: where the two disagree, other crops are tried and the answer closest to MoveNet's is kept.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import ModelError
from core_solver.perception.multipose import COCO_COUNT, Pose, person_size

Floats = NDArray[np.float32]
Image = NDArray[np.uint8]

_ALL_LANDMARKS = 39  # the 33, then mid-hips, circle point, and four that serve no purpose here
_MID_HIPS, _CIRCLE_POINT = 33, 34
_CROP = 256  # pixels
_MARGIN = 1.25  # of the circle around the body

KEYPOINT_FROM_LANDMARK = np.array(
    [0, 2, 5, 7, 8, 11, 12, 13, 14, 15, 16, 23, 24, 25, 26, 27, 28, 29, 30, 31, 32, 19, 20, 17, 18]
)
"""For each of our 25 keypoints BlazePose's landmark; the first 17 are COCO's."""

MIRRORED = np.concatenate([[0], np.arange(1, 25).reshape(-1, 2)[:, ::-1].ravel()])
"""For each of our 25 keypoints the one on the other side; the first 17 are COCO's."""

MIRRORED_COCO = MIRRORED[:COCO_COUNT]

_AGREED = 0.05  # of the person's size: mean distance to MoveNet below which the first crop was good
_AGREED_PX = 5.0  # MoveNet itself is no better than this for small people
_WRONG_SIDE = 0.7  # of that distance: so near with left and right exchanged, the person was taken from the wrong side
_SHOULDERS, _HIPS = [5, 6], [11, 12]  # COCO
_TRUSTED = 0.2  # MoveNet's keypoint score


@dataclass(frozen=True)
class Roi:
    """A turned square of the picture.

    Attributes:
        center: (2,) pixels.
        size: side, pixels.
        angle: radians from the picture's "up" to the person's, clockwise.
    """

    center: Floats
    size: float
    angle: float

    def crop_to_image(self) -> NDArray[np.float64]:
        """(2, 3) affine map from crop pixels to picture pixels, both with pixel centres at half-integers."""
        turn = self.size / _CROP * rotation(self.angle)
        return np.column_stack([turn, self.center - turn @ np.full(2, _CROP / 2)])


@dataclass(frozen=True)
class BodyLandmarks:
    """One person as BlazePose sees it, 25 keypoints in our order.

    Attributes:
        presence: in [0, 1], whether there is a person in the crop. It does not reject all that is not one.
        keypoints: (25, 2) pixels.
        visibility: (25,) in [0, 1], seen and inside the picture.
        landmarks: (25, 3) metres, camera axes, origin mid-hips.
        mask: (256, 256) probability of the person, on the crop.
        crop: (256, 256, 3) BGR picture on which the network looked.
        roi: where the crop lies.
    """

    presence: float
    keypoints: Floats
    visibility: Floats
    landmarks: Floats
    mask: Floats
    crop: Image
    roi: Roi


class BlazePose:
    """BlazePose's landmark network as a .tflite file."""

    def __init__(self, path: Path) -> None:
        """Load the network.

        Args:
            path: the "full" variant; "heavy" makes right thighs shorter than left ones.

        Raises:
            ModelError: unreadable, or another kind of network.
        """
        self.path = path
        # On one core this network runs as fast as on two: the other is left to the other networks.
        self._network = _interpreter(path)
        self._input = self._network.get_input_details()[0]["index"]
        shapes = {tuple(d["shape"]): d["index"] for d in self._network.get_output_details()}
        try:
            self._points = shapes[1, _ALL_LANDMARKS * 5]
            self._presence = shapes[1, 1]
            self._mask = shapes[1, _CROP, _CROP, 1]
            self._metres = shapes[1, _ALL_LANDMARKS * 3]
        except KeyError as error:
            raise ModelError(f"{path.name} is not BlazePose's landmark network: an output is missing") from error

    def __call__(self, image: Image, pose: Pose) -> BodyLandmarks:
        """The person that MoveNet found, in a (H, W, 3) BGR picture."""
        roi = roi_from_pose(pose)
        best, points = self._look(image, roi)
        least = disagreement(pose, best)
        agreed = max(_AGREED, _AGREED_PX / person_size(pose))
        for other in other_rois(roi, points):
            if least <= agreed:
                return best
            body, _ = self._look(image, other)
            value = disagreement(pose, body)
            if value < least:
                best, least = body, value
        wrong_side = least > agreed and disagreement(pose, best, mirrored=True) < _WRONG_SIDE * least
        return with_sides_exchanged(best) if wrong_side else best

    def _look(self, image: Image, roi: Roi) -> tuple[BodyLandmarks, Floats]:
        """The person in this crop, and the network's (39, 5) points in crop pixels."""
        crop = cut(image, roi)
        self._network.set_tensor(self._input, crop[None, ..., ::-1].astype(np.float32) / 255)
        self._network.invoke()
        points = self._output(self._points).reshape(_ALL_LANDMARKS, 5)
        presence = float(self._output(self._presence)[0])
        return _body_landmarks(
            points, presence, self._output(self._metres), self._output(self._mask), crop, roi
        ), points

    def _output(self, index: int) -> Floats:
        return self._network.get_tensor(index)[0]


def roi_from_pose(pose: Pose) -> Roi:
    """A crop around MoveNet's person: upright along the line from hips to shoulders, all keypoints inside."""
    trusted = pose.confidence > _TRUSTED
    torso_seen = trusted[_SHOULDERS + _HIPS].all()
    corners = pose.box.reshape(2, 2)
    hips = pose.keypoints[_HIPS].mean(axis=0)
    center = hips if torso_seen else corners.mean(axis=0)
    up = pose.keypoints[_SHOULDERS].mean(axis=0) - hips
    angle = float(np.arctan2(up[0], -up[1])) if torso_seen else 0.0
    reach = np.linalg.norm(pose.keypoints[trusted] - center, axis=1).max(initial=0.0)
    box_reach = float(np.max(corners[1] - corners[0])) / 2
    # The head reaches above the eyes and the feet below the ankles.
    return Roi(center.astype(np.float32), 2 * _MARGIN * max(1.15 * float(reach), box_reach, 1.0), angle)


def roi_from_points(points: Floats, roi: Roi) -> Roi:
    """The next crop from the landmarks (39, 5) found in this one."""
    center, above = transform(roi.crop_to_image(), points[[_MID_HIPS, _CIRCLE_POINT], :2])
    up = above - center
    radius = max(float(np.hypot(*up)), 1.0)
    return Roi(center.astype(np.float32), 2 * _MARGIN * radius, float(np.arctan2(up[0], -up[1])))


def other_rois(roi: Roi, points: Floats) -> tuple[Roi, ...]:
    """Further crops worth a look where the first one, which gave these points (39, 5), led astray.

    A leaning person turned upright is the likeliest to be taken from the wrong side: so turn less. Measured on such
    people, half the turn succeeds twice as often as any other change.
    """
    away = np.copysign(0.4, roi.angle)
    angles = (roi.angle / 2, roi.angle - away, 0.0) if abs(roi.angle) > 0.3 else (roi.angle - 0.2, roi.angle + 0.2)
    turned = tuple(Roi(roi.center, roi.size, float(angle)) for angle in angles)
    return (*turned, roi_from_points(points, roi), Roi(roi.center, 1.15 * roi.size, roi.angle))


def with_sides_exchanged(body: BodyLandmarks) -> BodyLandmarks:
    """The same points under the names of the other side."""
    return replace(
        body,
        keypoints=body.keypoints[MIRRORED],
        visibility=body.visibility[MIRRORED],
        landmarks=body.landmarks[MIRRORED],
    )


def cut(image: Image, roi: Roi) -> Image:
    """The (256, 256, 3) crop; black outside the picture."""
    shrink = roi.size / _CROP
    if shrink > 2:  # bilinear sampling would skip pixels
        factor = 1 / np.floor(shrink)
        part, offset = _around(image, roi)
        if part.size == 0:
            return np.zeros((_CROP, _CROP, 3), np.uint8)
        image = cv2.resize(part, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
        factors = np.array(image.shape[1::-1]) / part.shape[1::-1]
        moved = (roi.crop_to_image() - np.column_stack([np.zeros((2, 2)), offset])) * factors[:, None]
        return warp(image, moved, (_CROP, _CROP))
    return warp(image, roi.crop_to_image(), (_CROP, _CROP))


def warp(image: NDArray, output_to_input: NDArray[np.float64], size: tuple[int, int]) -> NDArray:
    """Sample an image at an affine map (2, 3) between pixel positions with centres at half-integers.

    Args:
        image: (h, w) or (h, w, c).
        output_to_input: from the wanted image's pixels to the given one's.
        size: (width, height) wanted.
    """
    # OpenCV counts pixel centres from 0.
    shifted = output_to_input.copy()
    shifted[:, 2] += shifted[:, :2] @ (0.5, 0.5) - 0.5
    return cv2.warpAffine(image, shifted, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)


def transform(affine: NDArray[np.float64], points: NDArray) -> NDArray[np.float64]:
    """Apply a (2, 3) affine map to points (n, 2)."""
    return points @ affine[:, :2].T + affine[:, 2]


def inverse(affine: NDArray[np.float64]) -> NDArray[np.float64]:
    """The (2, 3) affine map that undoes another."""
    back = np.linalg.inv(affine[:, :2])
    return np.column_stack([back, -back @ affine[:, 2]])


def rotation(angle: float) -> NDArray[np.float64]:
    """(2, 2) rotation of the picture plane, clockwise on the screen for a positive angle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _around(image: Image, roi: Roi) -> tuple[Image, NDArray[np.float64]]:
    """The picture's part that a crop can touch, and its top left pixel."""
    corners = transform(roi.crop_to_image(), np.array([[0, 0], [_CROP, 0], [0, _CROP], [_CROP, _CROP]]))
    left, top = np.clip(np.floor(corners.min(axis=0)).astype(int) - 1, 0, None)
    right, bottom = np.clip(np.ceil(corners.max(axis=0)).astype(int) + 1, 0, None)
    return image[top:bottom, left:right], np.array([left, top], float)


def disagreement(pose: Pose, body: BodyLandmarks, *, mirrored: bool = False) -> float:
    """Mean distance of the keypoints of both networks, as a share of the person's size.

    Args:
        pose: MoveNet's, whose confidence weighs the keypoints.
        body: BlazePose's.
        mirrored: compare left with right, which is what a person taken from the wrong side looks like.
    """
    own = body.keypoints[MIRRORED_COCO if mirrored else slice(COCO_COUNT)]
    distance = np.linalg.norm(own - pose.keypoints, axis=1) / person_size(pose)
    return float(np.average(distance, weights=pose.confidence + 1e-3))


def _body_landmarks(
    points: Floats, presence: float, metres: Floats, mask: Floats, crop: Image, roi: Roi
) -> BodyLandmarks:
    chosen = points[KEYPOINT_FROM_LANDMARK]
    body = metres.reshape(_ALL_LANDMARKS, 3)[KEYPOINT_FROM_LANDMARK].astype(np.float64)
    # The crop was turned upright: turn its axes back to the camera's. Depth, along the viewing ray, is untouched.
    body[:, :2] = body[:, :2] @ rotation(roi.angle).T
    body -= body[_HIPS].mean(axis=0)
    return BodyLandmarks(
        presence=presence,
        keypoints=transform(roi.crop_to_image(), chosen[:, :2]).astype(np.float32),
        visibility=_sigmoid(chosen[:, 3]) * _sigmoid(chosen[:, 4]),
        landmarks=body.astype(np.float32),
        mask=_sigmoid(mask[..., 0]),
        crop=crop,
        roi=roi,
    )


def _sigmoid(logits: Floats) -> Floats:
    return (1 / (1 + np.exp(-np.clip(logits, -60, 60)))).astype(np.float32)


def _interpreter(path: Path):
    from ai_edge_litert.interpreter import Interpreter  # noqa: PLC0415 - slow to load

    try:
        with _silent_libraries():
            network = Interpreter(str(path), num_threads=1)
            network.allocate_tensors()
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"{path.name} is no readable .tflite network: fetch it again") from error
    shape = tuple(network.get_input_details()[0]["shape"])
    if shape != (1, _CROP, _CROP, 3):
        raise ModelError(f"{path.name} is not BlazePose's landmark network: its input is {shape}")
    return network


@contextmanager
def _silent_libraries() -> Iterator[None]:
    """Drop what C++ code writes to standard error: the interpreter has no switch for its greeting."""
    try:
        kept = os.dup(2)
    except OSError:  # a program without standard error
        yield
        return
    try:
        with open(os.devnull, "wb") as nowhere:  # noqa: PTH123 - os.devnull is no path on Windows
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
