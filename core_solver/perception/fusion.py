"""One detection from what MoveNet and BlazePose say about the same person; doubt where they disagree."""

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.perception.appearance import describe_clothes
from core_solver.perception.blazepose import BodyLandmarks, disagreement, inverse, transform, warp
from core_solver.perception.multipose import COCO_COUNT, Pose, person_size, same_person
from core_solver.perception.observations import CroppedMask, Detection

Floats = NDArray[np.float32]

_LEAST_PRESENCE = 0.5
_GROSS = 0.14  # of the person's size: mean distance at which the two networks see different things
_TOLERANCE, _DOUBT = 0.03, 0.05  # of the person's size: distance without doubt, and the fall beyond it
_TOLERANCE_PX = 3.0  # MoveNet itself is no better than this for small people
_ALONE = 0.25  # MoveNet's score from which it is believed without BlazePose; lamp posts and bushes stay below
_CERTAIN = 0.3  # MoveNet's keypoint score from which its opinion counts in full

_MOVENET_WEIGHT = 2.0  # its scores run to about 0.8, BlazePose's visibility to 1

# Hands and feet, which MoveNet does not know, share the doubt about their wrist or ankle and move with it.
_WITNESS = np.array([*range(COCO_COUNT), 15, 16, 15, 16, 9, 10, 9, 10])

_MASK_EDGE = 25  # of 255: cells below are outside
_MASK_INSIDE = 128
_LEAST_OWN = 0.3  # of a person's cells
_MOST_BORROWED = 0.6  # of a person's keypoints


def fuse(pose: Pose, body: BodyLandmarks, picture: tuple[int, int], labels: tuple[int, int]) -> Detection | None:
    """One person, or None where there is none.

    BlazePose loses people who are half hidden or small, and slides to their neighbours. Where it does not mean the same
    person, MoveNet alone is believed if it is sure: such a person has no landmarks, no hands and feet, and no mask.

    Args:
        pose: MoveNet's.
        body: BlazePose's, from a crop around it.
        picture: (width, height) of the frame.
        labels: (width, height) of the label grid.
    """
    # Someone taken from the wrong side is still someone.
    difference = min(disagreement(pose, body), disagreement(pose, body, mirrored=True))
    mask = warp_mask(body, picture, labels)
    if body.presence < _LEAST_PRESENCE or difference > _GROSS or mask.values.size == 0:
        return _movenet_alone(pose, body, picture) if pose.score >= _ALONE else None
    keypoints, confidence = blended_keypoints(pose, body, picture)
    in_crop = transform(inverse(body.roi.crop_to_image()), body.keypoints)
    return Detection(
        score=pose.score,
        box=_box(pose, keypoints[confidence > 0.3], picture),
        keypoints=keypoints,
        confidence=confidence,
        landmarks=body.landmarks,
        appearance=describe_clothes(body.crop, body.mask, in_crop.astype(np.float32)),
        mask=mask,
    )


def _movenet_alone(pose: Pose, body: BodyLandmarks, picture: tuple[int, int]) -> Detection:
    """What MoveNet saw, with its own confidence."""
    keypoints = np.concatenate([pose.keypoints, pose.keypoints[_WITNESS[COCO_COUNT:]]])
    confidence = np.zeros(len(_WITNESS), np.float32)
    confidence[:COCO_COUNT] = pose.confidence * np.all((pose.keypoints >= 0) & (pose.keypoints < picture), axis=1)
    in_crop = transform(inverse(body.roi.crop_to_image()), keypoints).astype(np.float32)
    return Detection(
        score=pose.score,
        box=_box(pose, keypoints[confidence > 0.3], picture),
        keypoints=keypoints.astype(np.float32),
        confidence=confidence,
        landmarks=np.full((len(_WITNESS), 3), np.nan, np.float32),
        appearance=describe_clothes(body.crop, np.ones_like(body.mask), in_crop),
        mask=CroppedMask(0, 0, np.zeros((0, 0), np.uint8)),
    )


def blended_keypoints(pose: Pose, body: BodyLandmarks, picture: tuple[int, int]) -> tuple[Floats, Floats]:
    """Keypoints (25, 2) between both networks' and their confidence (25,).

    Where the two agree, their mean is a quarter to a third nearer the truth than either. Where they do not, BlazePose's
    point stays, in doubt as far as MoveNet is sure of its own. Outside the picture nothing is seen.
    """
    difference = pose.keypoints - body.keypoints[:COCO_COUNT]
    distance = np.linalg.norm(difference, axis=1) / person_size(pose)
    tolerance = max(_TOLERANCE, _TOLERANCE_PX / person_size(pose))
    agreement = np.exp(-0.5 * (np.maximum(distance - tolerance, 0) / _DOUBT) ** 2)
    weight = agreement * _MOVENET_WEIGHT * pose.confidence
    share = weight / (weight + body.visibility[:COCO_COUNT] + 1e-6)
    keypoints = body.keypoints + (difference * share[:, None])[_WITNESS]
    trust = 1 - np.clip(pose.confidence / _CERTAIN, 0, 1) * (1 - agreement)
    inside = np.all((keypoints >= 0) & (keypoints < picture), axis=1)
    return keypoints.astype(np.float32), (body.visibility * trust[_WITNESS] * inside).astype(np.float32)


def warp_mask(body: BodyLandmarks, picture: tuple[int, int], labels: tuple[int, int]) -> CroppedMask:
    """The mask on the label grid, cut to its bounding box; blobs apart from the person's body are left out."""
    to_labels = np.array(labels) / picture
    crop_to_labels = body.roi.crop_to_image() * to_labels[:, None]
    side = body.mask.shape[0]
    corners = transform(crop_to_labels, np.array([[0, 0], [side, 0], [0, side], [side, side]]))
    left, top = np.clip(np.floor(corners.min(axis=0)).astype(int), 0, labels)
    right, bottom = np.clip(np.ceil(corners.max(axis=0)).astype(int), 0, labels)
    if right <= left or bottom <= top:
        return CroppedMask(0, 0, np.zeros((0, 0), np.uint8))
    cells_to_crop = inverse(crop_to_labels)
    cells_to_crop[:, 2] += cells_to_crop[:, :2] @ (left, top)
    values = np.round(255 * warp(body.mask, cells_to_crop, (right - left, bottom - top))).astype(np.uint8)
    seen = (body.keypoints[body.visibility > 0.5] * to_labels - (left, top)).astype(int)
    return _trim(_connected(values, seen), int(top), int(left))


def without_doubles(detections: list[Detection], labels: tuple[int, int]) -> tuple[Detection, ...]:
    """One detection a person, surest first.

    Two finds may turn out to be the same person once BlazePose has looked closer, or a find may be a mixture of two
    neighbours: either claims hardly any cells of the label grid (width, height) that a surer one does not claim, or
    stands on the joints of surer ones.
    """
    kept: list[Detection] = []
    claimed = np.zeros((labels[1], labels[0]), bool)
    for one in sorted(detections, key=lambda d: -d.score * float(d.confidence.mean())):
        inside = one.mask.values >= _MASK_INSIDE
        rows, columns = inside.shape
        place = claimed[one.mask.top : one.mask.top + rows, one.mask.left : one.mask.left + columns]
        of_its_own = np.count_nonzero(inside & ~place) / np.count_nonzero(inside) if inside.any() else 1.0
        if of_its_own < _LEAST_OWN or _borrowed(one, kept) > _MOST_BORROWED:
            continue
        place |= inside
        kept.append(one)
    return tuple(kept)


def _borrowed(one: Detection, kept: list[Detection]) -> float:
    """Share of a detection's keypoints that lie on the same keypoints of surer people; 1 for one of them again."""
    if any(same_person(_as_pose(one), _as_pose(other)) for other in kept):
        return 1.0
    seen = one.confidence[:COCO_COUNT] > _CERTAIN
    if not kept or not seen.any():
        return 0.0
    others = np.stack([other.keypoints[:COCO_COUNT] for other in kept])
    apart = np.linalg.norm(others - one.keypoints[:COCO_COUNT], axis=-1) / person_size(_as_pose(one))
    sure = np.stack([other.confidence[:COCO_COUNT] for other in kept]) > _CERTAIN
    return float(np.mean(((apart < _TOLERANCE) & sure).any(axis=0)[seen]))


def _as_pose(detection: Detection) -> Pose:
    return Pose(
        detection.score, detection.box, detection.keypoints[:COCO_COUNT], detection.confidence[:COCO_COUNT]
    )  # fmt: skip


def _box(pose: Pose, seen: Floats, picture: tuple[int, int]) -> Floats:
    """Around MoveNet's box and every seen keypoint (n, 2), inside the picture."""
    points = np.concatenate([pose.box.reshape(2, 2), seen])
    low, high = np.clip(points.min(axis=0), 0, picture), np.clip(points.max(axis=0), 0, picture)
    return np.concatenate([low, high]).astype(np.float32)


def _connected(values: NDArray[np.uint8], seen: NDArray[np.int_]) -> NDArray[np.uint8]:
    """Only the blobs on which at least one seen keypoint (n, 2) x, y lies; all of them if there is none."""
    _, blobs = cv2.connectedComponents((values >= _MASK_EDGE).astype(np.uint8))
    height, width = values.shape
    seen = seen[np.all((seen >= 0) & (seen < (width, height)), axis=1)]
    own = set(blobs[seen[:, 1], seen[:, 0]].tolist()) - {0}
    if not own:
        return values
    return np.where(np.isin(blobs, list(own)), values, 0).astype(np.uint8)


def _trim(values: NDArray[np.uint8], top: int, left: int) -> CroppedMask:
    rows = np.flatnonzero((values >= _MASK_EDGE).any(axis=1))
    columns = np.flatnonzero((values >= _MASK_EDGE).any(axis=0))
    if len(rows) == 0:
        return CroppedMask(0, 0, np.zeros((0, 0), np.uint8))
    inner = values[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return CroppedMask(top + int(rows[0]), left + int(columns[0]), np.ascontiguousarray(inner))
