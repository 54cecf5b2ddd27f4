"""One detection from the default networks and the declared ones, whose word goes before."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import keypoint_index
from core_solver.perception.appearance import describe_clothes
from core_solver.perception.blazepose import BlazePose, Roi, cut, inverse, roi_from_pose, transform, warp
from core_solver.perception.fusion import fuse
from core_solver.perception.multipose import COCO_COUNT
from core_solver.perception.networks.keypoint_sets import KEYPOINT_SETS, NamedKeypoints
from core_solver.perception.networks.people import Person
from core_solver.perception.observations import CroppedMask, Detection

Image = NDArray[np.uint8]
Floats = NDArray[np.float32]

_SEEN = 0.3  # confidence from which a keypoint lies in the box
_FEET = [keypoint_index(name) for name in ("left_heel", "right_heel", "left_toe", "right_toe")]


def detect(
    person: Person, image: Image, body: BlazePose, picture: tuple[int, int], labels: tuple[int, int]
) -> Detection | None:
    """A person, or None where BlazePose sees nobody and the declared networks do not say enough.

    BlazePose is asked for what the declared networks leave open: mask, landmarks, hands and feet.

    Args:
        person: what the declared networks say.
        image: (H, W, 3) BGR picture.
        body: asked where something is open.
        picture: (width, height) of the picture.
        labels: (width, height) of the label grid.
    """
    complete = person.mask is not None and person.landmarks is not None
    if complete and person.keypoints is not None and person.keypoints.known[_FEET].all():
        return declared_detection(person, image, picture, labels)
    fused = fuse(person.pose, body(image, person.pose), picture, labels)
    if fused is not None:
        return overruled(fused, person, picture)
    return declared_detection(person, image, picture, labels) if complete else None


def overruled(detection: Detection, person: Person, picture: tuple[int, int]) -> Detection:
    """The default networks' detection with what the declared ones say in its place."""
    if person.keypoints is not None:
        known, points = person.keypoints.known, person.keypoints.points
        keypoints = np.where(known[:, None], points, detection.keypoints).astype(np.float32)
        confidence = np.where(known, _inside(person.keypoints, picture), detection.confidence).astype(np.float32)
        detection = replace(
            detection, keypoints=keypoints, confidence=confidence, box=_box(person, keypoints, confidence, picture)
        )
    mask = detection.mask if person.mask is None else person.mask
    detection = replace(detection, mask=mask)
    return detection if person.landmarks is None else replace(detection, landmarks=person.landmarks, regressed=True)


def declared_detection(
    person: Person, image: Image, picture: tuple[int, int], labels: tuple[int, int]
) -> Detection | None:
    """A detection from declared networks alone; keypoints that no network names have confidence 0."""
    if person.mask is None or person.landmarks is None:
        return None
    pose = person.pose
    named = person.keypoints or _coco(pose.keypoints, pose.confidence)
    confidence = _inside(named, picture)
    return Detection(
        score=pose.score,
        box=_box(person, named.points, confidence, picture),
        keypoints=named.points,
        confidence=confidence,
        landmarks=person.landmarks,
        appearance=_clothes(image, roi_from_pose(pose), person.mask, named.points, labels),
        mask=person.mask,
        regressed=True,
    )


def _coco(points: Floats, confidence: Floats) -> NamedKeypoints:
    return KEYPOINT_SETS["coco17"].named(points[:COCO_COUNT], confidence[:COCO_COUNT])


def _inside(named: NamedKeypoints, picture: tuple[int, int]) -> Floats:
    """Confidence (25,), 0 outside the picture, where nothing is seen."""
    inside = np.all((named.points >= 0) & (named.points < picture), axis=1)
    return (named.confidence * inside).astype(np.float32)


def _box(person: Person, keypoints: Floats, confidence: Floats, picture: tuple[int, int]) -> Floats:
    """Around the found box and every seen keypoint, inside the picture."""
    points = np.concatenate([person.pose.box.reshape(2, 2), keypoints[confidence > _SEEN]])
    low, high = np.clip(points.min(axis=0), 0, picture), np.clip(points.max(axis=0), 0, picture)
    return np.concatenate([low, high]).astype(np.float32)


def _clothes(image: Image, roi: Roi, mask: CroppedMask, points: Floats, labels: tuple[int, int]) -> Floats:
    """`describe_clothes` on the person's crop."""
    crop = cut(image, roi)
    picture = image.shape[1], image.shape[0]
    crop_to_cells = roi.crop_to_image() * (np.array(labels) / picture)[:, None]
    crop_to_cells[:, 2] -= mask.left, mask.top
    on_crop = warp(mask.values, crop_to_cells, (crop.shape[1], crop.shape[0])).astype(np.float32) / np.float32(255)
    return describe_clothes(crop, on_crop, transform(inverse(roi.crop_to_image()), points).astype(np.float32))
