"""Adapters: each declared network as something that looks at a picture and its people."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from core_solver.body import BodyModel
from core_solver.errors import ModelError
from core_solver.perception.blazepose import inverse, transform, warp
from core_solver.perception.multipose import COCO_COUNT, Pose, person_size
from core_solver.perception.networks.instances import Instances, read_mask2former, read_rtmdet, read_yolo_seg
from core_solver.perception.networks.keypoint_sets import KEYPOINT_SETS, NamedKeypoints
from core_solver.perception.networks.kinds import View
from core_solver.perception.networks.one_stage import FoundPeople, read_rtmo, read_yolo, read_yolo_end2end
from core_solver.perception.networks.prepare import cut, lay_picture, person_crop, to_tensor
from core_solver.perception.networks.session import DeclaredSession
from core_solver.perception.networks.smpl import (
    Regressed,
    along_ray,
    posed_keypoints,
    project,
    read_romp_maps,
    read_rotations,
)
from core_solver.perception.networks.spec import NetworkSpec
from core_solver.perception.networks.top_down import read_heatmaps, read_simcc
from core_solver.perception.observations import CroppedMask

Image = NDArray[np.uint8]
Floats = NDArray[np.float32]
Array = NDArray[np.float64]

_SEEN = 0.3  # confidence from which a keypoint votes
_LEAST_VOTES = 0.5  # of a person's keypoints inside a mask that is theirs
_FARTHEST = 0.5  # of a person's size: mean distance of a regressed body that is still theirs
_MASK_EDGE = 25  # of 255: cells below are outside


@dataclass(frozen=True)
class Person:
    """Someone in a picture and what declared networks say about them.

    Attributes:
        pose: where they are.
        keypoints: from a declared pose network.
        mask: from a declared mask network.
        landmarks: (25, 3) from a declared SMPL regressor, as `Detection.landmarks`.
    """

    pose: Pose
    keypoints: NamedKeypoints | None = None
    mask: CroppedMask | None = None
    landmarks: Floats | None = None

    def with_keypoints(self, keypoints: NamedKeypoints) -> "Person":
        """The same person with a declared pose network's word on the keypoints."""
        points, confidence = keypoints.points[:COCO_COUNT], keypoints.confidence[:COCO_COUNT]
        return replace(self, pose=replace(self.pose, keypoints=points, confidence=confidence), keypoints=keypoints)


class PeopleFinder:
    """A one-stage pose network: finds the people and their keypoints at once."""

    def __init__(self, spec: NetworkSpec, device: str) -> None:
        """Open the network; ModelError where the file is not as declared."""
        self._spec, self._session = spec, DeclaredSession(spec, device)

    def __call__(self, image: Image) -> tuple[Person, ...]:
        """The people in a (H, W, 3) BGR picture, surest first."""
        outputs, to_picture = look_at_picture(self._session, image)
        found = self._read(outputs)
        people = []
        for score, box, points, sure in zip(found.scores, found.boxes, found.points, found.confidence, strict=True):
            named = KEYPOINT_SETS[self._spec.keypoints].named(transform(to_picture, points), sure)
            corners = transform(to_picture, box.reshape(2, 2)).ravel().astype(np.float32)
            pose = Pose(float(np.clip(score, 0, 1)), corners, named.points[:COCO_COUNT], named.confidence[:COCO_COUNT])
            people.append(Person(pose, named))
        return tuple(people)

    def _read(self, outputs: list[NDArray]) -> FoundPeople:
        score, overlap = self._spec.score, self._spec.overlap
        if self._spec.decoder == "rtmo":
            return read_rtmo(outputs[0], outputs[1], score, overlap)
        read = read_yolo if self._spec.decoder == "yolo-pose" else read_yolo_end2end
        return read(outputs[0], score, overlap)


class CropPoses:
    """A top-down pose network: looks at each person's box, at all of a picture in one run where the graph allows."""

    def __init__(self, spec: NetworkSpec, device: str) -> None:
        """Open the network; ModelError where the file is not as declared."""
        self._spec, self._session = spec, DeclaredSession(spec, device)

    def __call__(self, image: Image, people: Sequence[Person]) -> tuple[Person, ...]:
        """The people with their keypoints as this network sees them; unsure ones count as unseen."""
        if not people:
            return ()
        outputs, crops, size = look_at_people(self._session, image, people)
        spec = self._spec
        if spec.decoder == "simcc":
            points, sure = read_simcc(outputs[0], outputs[1], size)
        else:
            points, sure = read_heatmaps(outputs[0], size, spec.refine, udp=spec.udp)
        sure = np.where(sure >= spec.score, sure, 0)
        keypoints = KEYPOINT_SETS[spec.keypoints]
        return tuple(
            person.with_keypoints(keypoints.named(transform(crop, own), confidence))
            for person, crop, own, confidence in zip(people, crops, points, sure, strict=True)
        )


class MaskFinder:
    """An instance mask network."""

    def __init__(self, spec: NetworkSpec, device: str) -> None:
        """Open the network; ModelError where the file is not as declared."""
        self._spec, self._session = spec, DeclaredSession(spec, device)

    def __call__(self, image: Image, people: Sequence[Person], labels: tuple[int, int]) -> tuple[Person, ...]:
        """The people, each with the mask that holds their keypoints, if there is one.

        Args:
            image: (H, W, 3) BGR picture.
            people: found in it.
            labels: (width, height) of the label grid.

        Raises:
            ModelError: the outputs do not fit together.
        """
        if not people:
            return ()
        outputs, to_picture = look_at_picture(self._session, image)
        try:
            found = self._read(outputs)
        except (ValueError, IndexError) as error:
            raise ModelError(f"the outputs of {self._spec.file.name} do not fit together: {error}") from error
        picture = image.shape[1], image.shape[0]
        planes = [self._on_labels(mask, to_picture, picture, labels) for mask in found.masks]
        owners = assign_masks(planes, [person.pose for person in people], picture)
        masks = [None if owner is None else cropped(planes[owner]) for owner in owners]
        return tuple(replace(person, mask=mask) for person, mask in zip(people, masks, strict=True))

    def _read(self, outputs: list[NDArray]) -> Instances:
        spec = self._spec
        score, person = spec.score, spec.person_class
        if spec.decoder == "rtmdet-ins":
            return read_rtmdet(outputs[0], outputs[1], outputs[2], score, person)
        if spec.decoder == "yolo-seg":
            return read_yolo_seg(outputs[0], outputs[1], _size(self._session), score, person, spec.overlap)
        return read_mask2former(outputs[0], outputs[1], score, person)

    def _on_labels(
        self, mask: Floats, to_picture: Array, picture: tuple[int, int], labels: tuple[int, int]
    ) -> NDArray[np.uint8]:
        """(height, width) of the label grid, probability times 255."""
        cells = np.array(mask.shape[::-1]) / _size(self._session)
        to_labels = to_picture * (np.array(labels) / picture)[:, None]
        from_labels = inverse(to_labels) * cells[:, None]
        return np.round(255 * warp(mask.astype(np.float32), from_labels, labels)).astype(np.uint8)


class BodyRegressor:
    """An SMPL regressor, shown each person or the whole picture."""

    def __init__(self, spec: NetworkSpec, device: str, body: BodyModel) -> None:
        """Open the network; ModelError where the file is not as declared."""
        self._spec, self._session, self._body = spec, DeclaredSession(spec, device), body
        if spec.decoder == "smpl" and spec.camera != "none" and not self._session.has("camera"):
            raise ModelError(
                f"{spec.file.name} is not as {spec.toml.name} declares: no output is the camera: "
                "name it with outputs.camera"
            )

    def __call__(self, image: Image, people: Sequence[Person]) -> tuple[Person, ...]:
        """The people with the landmarks of the body that was regressed for them.

        Raises:
            ModelError: the outputs are not those of 24 joints.
        """
        if not people:
            return ()
        if self._spec.view is View.PERSON:
            outputs, _, _ = look_at_people(self._session, image, people)
            bodies, _ = self._bodies(outputs)
            return tuple(self._with_body(person, body) for person, body in zip(people, bodies, strict=True))
        outputs, to_picture = look_at_picture(self._session, image)
        bodies, seen = self._bodies(outputs)
        places = [transform(to_picture, points) for points in seen]
        owners = assign_bodies(places, [person.pose for person in people])
        return tuple(
            person if owner is None else self._with_body(person, bodies[owner])
            for person, owner in zip(people, owners, strict=True)
        )

    def _bodies(self, outputs: list[NDArray]) -> tuple[Array, Array]:
        """Landmarks (N, 25, 3) along each person's ray, and their places (N, 25, 2) in the input."""
        spec, found = self._spec, self._read(outputs)
        try:
            points = posed_keypoints(read_rotations(found.pose, found.orient, spec.rotations), self._body, spec.axes)
        except ValueError as error:
            raise ModelError(f"{spec.file.name} is not as {spec.toml.name} declares: {error}") from error
        if found.camera is None or spec.camera == "none":
            return points, np.zeros((len(points), 0, 2))
        place = found.camera.astype(float)
        seen = project(points, place, spec.camera, _size(self._session), spec.fov_degrees)
        if spec.camera == "translation":
            points = along_ray(points, place)
        if spec.view is View.PICTURE and found.scores is not None:
            sure = found.scores.ravel() >= spec.score
            return points[sure], seen[sure]
        return points, seen

    def _read(self, outputs: list[NDArray]) -> Regressed:
        if self._spec.decoder == "romp-maps":
            return read_romp_maps(outputs[0], outputs[1], self._spec.score)
        pose, orient, camera, scores, _ = outputs
        return Regressed(pose, orient, camera, scores)

    @staticmethod
    def _with_body(person: Person, body: Array) -> Person:
        return replace(person, landmarks=body.astype(np.float32)) if np.isfinite(body).all() else person


def look_at_picture(session: DeclaredSession, image: Image) -> tuple[list, Array]:
    """A network's outputs for a whole picture, and the map from its input to the picture."""
    laid, to_picture = lay_picture(image, _size(session), session.spec)
    return session([to_tensor(laid, session.spec)]), to_picture


def look_at_people(
    session: DeclaredSession, image: Image, people: Sequence[Person]
) -> tuple[list, list[Array], tuple[int, int]]:
    """A network's outputs for each person's crop, the maps from the crops to the picture, and the crops' size."""
    size = _size(session)
    crops = [person_crop(person.pose.box, size, session.spec.padding) for person in people]
    return session([to_tensor(cut(image, crop, size), session.spec) for crop in crops]), crops, size


def assign_masks(
    planes: Sequence[NDArray[np.uint8]], poses: Sequence[Pose], picture: tuple[int, int]
) -> list[int | None]:
    """For each person the mask (h, w) that holds most of their keypoints; a mask belongs to one person at most."""
    votes = np.array([[_votes(plane, pose, picture) for plane in planes] for pose in poses], float)
    costs: Array = 1.0 - votes.reshape(len(poses), len(planes))
    return _assign(costs, 1 - _LEAST_VOTES)


def assign_bodies(places: Sequence[Array], poses: Sequence[Pose]) -> list[int | None]:
    """For each person the regressed body (25, 2) in the picture that lies nearest their keypoints."""

    def distance(pose: Pose, points: Array) -> float:
        gaps = np.linalg.norm(points[:COCO_COUNT] - pose.keypoints, axis=1) / person_size(pose)
        return float(np.average(np.nan_to_num(gaps, nan=9.0), weights=pose.confidence + 1e-6))

    distances = np.array([[distance(pose, points) for points in places] for pose in poses])
    return _assign(distances.reshape(len(poses), len(places)), _FARTHEST)


def cropped(plane: NDArray[np.uint8]) -> CroppedMask | None:
    """A mask cut to what is in it; None for an empty one."""
    inside = plane >= _MASK_EDGE
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    if len(rows) == 0:
        return None
    top, left = int(rows[0]), int(columns[0])
    return CroppedMask(top, left, np.ascontiguousarray(plane[top : rows[-1] + 1, left : columns[-1] + 1]))


def _votes(plane: NDArray[np.uint8], pose: Pose, picture: tuple[int, int]) -> float:
    """Share of the person's confident keypoints inside the mask."""
    rows, columns = plane.shape
    cells = np.floor(pose.keypoints * ((columns, rows) / np.array(picture))).astype(int)
    counts = (pose.confidence >= _SEEN) & np.all((cells >= 0) & (cells < (columns, rows)), axis=1)
    if not counts.any():
        return 0.0
    return float(np.average(plane[cells[counts, 1], cells[counts, 0]] >= 128, weights=pose.confidence[counts]))


def _assign(costs: Array, most: float) -> list[int | None]:
    """For each row the column that is its own in the cheapest assignment, None above the highest cost."""
    owners: list[int | None] = [None] * len(costs)
    for row, column in zip(*linear_sum_assignment(costs), strict=True):
        if costs[row, column] <= most:
            owners[row] = int(column)
    return owners


def _size(session: DeclaredSession) -> tuple[int, int]:
    """The input's size, which every network but those for depth has."""
    if session.size is None:
        raise ModelError(f"{session.spec.toml.name}: the key 'input' is missing")
    return session.size
