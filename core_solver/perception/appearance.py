"""A short description of a person's clothes, to tell people apart over time."""

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

_BINS = 6  # per colour channel
_CHANNEL_RANGES = np.array([[0, 255], [88, 168], [88, 168]], np.float32)  # OpenCV's 8-bit Lab; clothes are rarely vivid
_TORSO = [5, 6, 12, 11]  # around the torso: shoulders and hips
_LEGS = [[11, 13], [13, 15], [12, 14], [14, 16]]
_LEG_WIDTH = 0.3  # of the torso's length

APPEARANCE_SIZE = 2 * 3 * _BINS


def describe_clothes(crop: NDArray[np.uint8], mask: Floats, keypoints: Floats) -> Floats:
    """Colour histograms of torso and legs.

    Args:
        crop: (h, w, 3) BGR picture of one person.
        mask: (h, w) probability of the person.
        keypoints: (25, 2) pixels of the crop.

    Returns:
        (36,) unit vector; the dot product of two is 1 for the same colours.
    """
    lab = cv2.cvtColor(crop, cv2.COLOR_BGR2LAB).astype(np.float32)
    regions = (_torso_region(mask.shape, keypoints), _legs_region(mask.shape, keypoints))
    histograms = [_histogram(lab, mask * region) for region in regions]
    # The square root makes the dot product Hellinger's affinity of the histograms.
    vector = np.sqrt(np.concatenate(histograms)) + 1e-6
    return (vector / np.linalg.norm(vector)).astype(np.float32)


def _torso_region(shape: tuple[int, ...], keypoints: Floats) -> NDArray[np.uint8]:
    region = np.zeros(shape, np.uint8)
    cv2.fillConvexPoly(region, cv2.convexHull(_pixels(keypoints[_TORSO])), (1,))
    return region


def _legs_region(shape: tuple[int, ...], keypoints: Floats) -> NDArray[np.uint8]:
    region = np.zeros(shape, np.uint8)
    torso = np.linalg.norm(keypoints[[5, 6]].mean(axis=0) - keypoints[[11, 12]].mean(axis=0))
    width = int(np.clip(_LEG_WIDTH * torso, 1, 100))
    for bone in _LEGS:
        start, end = _pixels(keypoints[bone])
        cv2.line(region, start.tolist(), end.tolist(), (1,), width)
    return region


def _pixels(points: Floats) -> NDArray[np.int32]:
    return np.clip(np.round(points), -10_000, 10_000).astype(np.int32)


def _histogram(lab: Floats, weights: Floats) -> Floats:
    """(18,) three softly binned channels of the weighted pixels, in sum 1; zeros without pixels."""
    chosen = weights > 0.5
    total = float(weights[chosen].sum())
    if total == 0:
        return np.zeros(3 * _BINS, np.float32)
    low, high = _CHANNEL_RANGES.T
    place = np.clip((lab[chosen] - low) / (high - low), 0, 1) * (_BINS - 1)
    # A colour between two bin centres counts in both, so that a slight change of light changes little.
    share = np.clip(1 - np.abs(place[:, :, None] - np.arange(_BINS)), 0, 1)
    return (np.einsum("n,ncb->cb", weights[chosen], share).ravel() / (3 * total)).astype(np.float32)
