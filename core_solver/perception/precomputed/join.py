"""Frames seen partly by other programs and partly by the default networks."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError
from core_solver.perception.appearance import describe_clothes
from core_solver.perception.blazepose import BlazePose, BodyLandmarks, disagreement, inverse, transform
from core_solver.perception.disparity import disparity_files, nearest_shape, open_disparity
from core_solver.perception.fusion import warp_mask, without_doubles
from core_solver.perception.multipose import COCO_COUNT, MultiPose, Pose
from core_solver.perception.networks.declared import Declared, open_declared
from core_solver.perception.networks.merging import detect
from core_solver.perception.observations import CroppedMask, Detection, FrameInfo, FrameObservations
from core_solver.perception.perceive import DepthNetwork, label_size
from core_solver.perception.precomputed.given import GivenModalities
from core_solver.perception.precomputed.joints import GivenPerson
from core_solver.perception.precomputed.masks import to_label_grid
from core_solver.perception.precomputed.matching import cropped, empty_mask, match_poses, share_masks
from core_solver.perception.precomputed.smpl import landmarks_from
from core_solver.perception.store import ModelStore
from core_solver.progress import Progress
from core_solver.video import VideoClip

Image = NDArray[np.uint8]
Floats = NDArray[np.float32]

_LEAST_PRESENCE = 0.5  # of somebody in BlazePose's crop
_GROSS = 0.14  # of the person's size: mean distance at which BlazePose sees somebody else
_MARGIN = 0.08  # of a person's size, from the outermost joints to the skin
_APPEARANCE_SIDE = 192  # pixels of the crop on which clothes are described


@dataclass(frozen=True)
class Helpers:
    """What a folder gives, and networks for what it lacks; None for what is not needed.

    Attributes:
        given: what is known about the video.
        people: finds people.
        body: looks at each of them.
        disparity_files: depth networks of one family in several shapes; empty without.
        declared: the user's own networks.
    """

    given: GivenModalities
    people: MultiPose | None
    body: BlazePose | None
    disparity_files: tuple[Path, ...]
    declared: Declared = field(default_factory=Declared)

    def files_for(self, width: int, height: int) -> tuple[Path, ...]:
        """The files that decide what is seen in a video of this size."""
        found = tuple(network.path for network in (self.people, self.body) if network is not None)
        depth = (nearest_shape(self.disparity_files, width / height),) if self.disparity_files else ()
        return (*found, *depth, *self.declared.files)

    def open_disparity(self, width: int, height: int) -> DepthNetwork | None:
        """The depth network for a video of this size, if there is one."""
        return self.declared.depth or open_disparity(self.disparity_files, width, height)


def load_helpers(
    store: ModelStore, depth: Path | None, named: Sequence[str | Path], device: str, given: GivenModalities
) -> Helpers:
    """Load the networks for what a folder lacks, fetching them on first use.

    BlazePose also looks at people whose SMPL pose is missing, if it is there already.

    Args:
        store: where models lie.
        depth: an ONNX disparity network, or a folder with one in several shapes; None for what the store holds.
        named: the user's own networks: TOML files, or names in the catalogue.
        device: "auto", "cpu" or "cuda", for the user's own.
        given: what need not be computed.

    Raises:
        UserError: a network is asked for what the folder gives.
        ModelError: a network that is needed is not to be had, or is damaged.
    """
    declared = open_declared(named, store, device) if named else Declared()
    _require_new(declared, depth, given)
    everything_of_a_person = given.joints is not None and given.smpl is not None and given.masks is not None
    body = store.path("blazepose-full") if everything_of_a_person else store.require("blazepose-full")
    files: tuple[Path, ...] = ()
    if given.depth is None and declared.depth is None:
        files = store.files("disparity") if depth is None else disparity_files(depth)
    return Helpers(
        given,
        MultiPose(store.require("movenet-multipose")) if given.joints is None else None,
        BlazePose(body) if body is not None else None,
        files,
        declared,
    )


def _require_new(declared: Declared, depth: Path | None, given: GivenModalities) -> None:
    """Nothing may be both given and computed: the user would not know which of the two was used."""
    twice = {
        "joints": given.joints is not None and (declared.finder is not None or declared.poses is not None),
        "SMPL poses": given.smpl is not None and declared.bodies is not None,
        "masks": given.masks is not None and declared.masks is not None,
        "depth": given.depth is not None and (depth is not None or declared.depth is not None),
    }
    for what, is_twice in twice.items():
        if is_twice:
            raise UserError(f"{given.folder.path} already holds {what}: leave networks for the same out")
    if given.joints is not None and (declared.masks is not None or declared.bodies is not None):
        raise UserError(f"{given.folder.path} holds joints: of your own networks only depth can be used beside them")


def perceive_given(
    clip: VideoClip, helpers: Helpers, progress: Progress, positions: Sequence[int]
) -> Iterator[FrameObservations]:
    """Observe a clip frame by frame; memory does not grow with its length.

    Args:
        clip: the video.
        helpers: what is known about it, and networks for the rest.
        progress: shows one stage.
        positions: increasing positions in the clip's frame list.

    Raises:
        UserError: a file is damaged.
        VideoError: a frame cannot be decoded.
        ModelError: the depth network does not fit.
    """
    joiner = _Joiner(helpers, helpers.open_disparity(clip.width, clip.height))
    with progress.stage("Join what is given", len(positions)) as advance:
        for frame, image in clip.frames_at(positions):
            yield joiner.observe(image, frame)
            advance(1)


@dataclass(frozen=True)
class _Joiner:
    """Puts one frame's modalities together."""

    helpers: Helpers
    disparity: DepthNetwork | None

    @property
    def given(self) -> GivenModalities:
        """What is known about the video."""
        return self.helpers.given

    def observe(self, image: Image, frame: FrameInfo) -> FrameObservations:
        labels = label_size(*self.given.size)
        people = self._with_poses(self._people(image, frame.index), frame.index)
        people, unclaimed = self._with_masks(people, frame.index, labels)
        people = [self._completed(image, person, labels) for person in people]
        unclaimed += [_around(person, self.given.size, labels) for person in people if person.mask.values.size == 0]
        if self._is_unknown(frame.index):
            unclaimed.append(CroppedMask(0, 0, np.full(labels[::-1], 255, np.uint8)))
        plane = self.given.disparity_at(frame.index)
        if plane is None and self.disparity is not None:
            plane = self.disparity(image)
        return FrameObservations(frame, tuple(people), plane, tuple(unclaimed))

    def _people(self, image: Image, frame: int) -> list[Detection]:
        """With joints, and with all the rest where networks have found them."""
        if self.helpers.people is not None and self.helpers.body is not None:
            size, labels = self.given.size, label_size(*self.given.size)
            people = self.helpers.declared.look(image, self.helpers.people, labels)
            seen = [detect(person, image, self.helpers.body, size, labels) for person in people]
            return list(without_doubles([person for person in seen if person is not None], labels))
        found = [detection_from(person, self.given.size) for person in self.given.people_at(frame) or ()]
        return [person for person in found if person is not None]

    def _with_poses(self, people: list[Detection], frame: int) -> list[Detection]:
        """Landmarks from SMPL poses, where these are given and fit."""
        poses = self.given.poses_at(frame)
        own = match_poses(people, [pose.points for pose in poses if pose.points is not None])
        named = self.given.identities_from == "smpl"
        return [
            replace(
                person,
                landmarks=landmarks_from(poses[own[i]].theta, self.given.body),
                regressed=True,
                identity=poses[own[i]].identity if named else person.identity,
            )
            if i in own
            else person
            for i, person in enumerate(people)
        ]

    def _with_masks(
        self, people: list[Detection], frame: int, labels: tuple[int, int]
    ) -> tuple[list[Detection], list[CroppedMask]]:
        """Given masks for people, and those that are nobody's; a frame without any leaves everybody without."""
        if self.given.masks is None:
            return people, []
        masks = self.given.masks_at(frame)
        grids = [to_label_grid(mask, labels) for mask in masks]
        shared = share_masks(people, grids, self.given.size)
        named = self.given.identities_from == "masks"
        taken: set[int | None] = set()
        with_masks = []
        for person, own in zip(people, shared.owned, strict=True):
            mask = cropped(np.max([grids[m] for m in own], axis=0)) if own else empty_mask()
            identity = masks[own[0]].identity if named and own else person.identity
            # An id stays with one person of a frame, even if its mask is in two pieces on two people.
            identity = None if named and identity in taken else identity
            taken.add(identity)
            with_masks.append(replace(person, mask=mask, identity=identity))
        return with_masks, [cropped(grids[m]) for m in shared.nobodys]

    def _completed(self, image: Image, person: Detection, labels: tuple[int, int]) -> Detection:
        """What is still missing about a person, as BlazePose sees it."""
        if self.helpers.people is not None:
            return person
        lacks_landmarks = not np.isfinite(person.landmarks).all()
        lacks_mask = self.given.masks is None
        if self.helpers.body is not None and (lacks_landmarks or lacks_mask):
            pose = Pose(person.score, person.box, person.keypoints[:COCO_COUNT], person.confidence[:COCO_COUNT])
            body = self.helpers.body(image, pose)
            if body.presence >= _LEAST_PRESENCE and disagreement(pose, body) <= _GROSS:
                mask = warp_mask(body, self.given.size, labels) if lacks_mask else person.mask
                return _with_body(person, body, mask, self.given.size)
        return replace(person, appearance=_clothes(image, person, labels))

    def _is_unknown(self, frame: int) -> bool:
        """Whether nothing says where people are in a frame, so that none of it can be called background."""
        joints_missing = self.given.joints is not None and self.given.people_at(frame) is None
        return joints_missing and not self.given.knows_masks_at(frame)


def detection_from(person: GivenPerson, picture: tuple[int, int]) -> Detection | None:
    """A detection with joints only; None for somebody outside the picture (width, height)."""
    inside = np.all((person.keypoints >= 0) & (person.keypoints < picture), axis=1)
    confidence = np.where(inside, person.confidence, 0).astype(np.float32)
    seen = person.keypoints[confidence > 0]
    if len(seen) == 0:
        return None
    margin = _MARGIN * float(np.max(np.ptp(seen, axis=0)))
    low, high = (np.clip(corner, 0, picture) for corner in (seen.min(axis=0) - margin, seen.max(axis=0) + margin))
    return Detection(
        score=person.score,
        box=np.concatenate([low, high]).astype(np.float32),
        keypoints=person.keypoints,
        confidence=confidence,
        landmarks=np.full((len(person.keypoints), 3), np.nan, np.float32),
        appearance=np.zeros(0, np.float32),
        mask=empty_mask(),
        identity=person.identity,
    )


def _with_body(person: Detection, body: BodyLandmarks, mask: CroppedMask, picture: tuple[int, int]) -> Detection:
    """Landmarks, if there are none, and hands and feet, if the given skeleton has none, from BlazePose."""
    inside = np.all((body.keypoints >= 0) & (body.keypoints < picture), axis=1)
    lacking = (person.confidence == 0) & (np.arange(len(person.confidence)) >= COCO_COUNT)
    has_landmarks = bool(np.isfinite(person.landmarks).all())
    in_crop = transform(inverse(body.roi.crop_to_image()), body.keypoints)
    return replace(
        person,
        keypoints=np.where(lacking[:, None], body.keypoints, person.keypoints).astype(np.float32),
        confidence=np.where(lacking, body.visibility * inside, person.confidence).astype(np.float32),
        landmarks=person.landmarks if has_landmarks else body.landmarks,
        appearance=describe_clothes(body.crop, body.mask, in_crop.astype(np.float32)),
        mask=mask,
    )


def _clothes(image: Image, person: Detection, labels: tuple[int, int]) -> Floats:
    """Colours of clothes from the picture, within the mask where there is one."""
    height, width = image.shape[:2]
    left, top = np.floor(person.box[:2]).astype(int)
    right, bottom = np.maximum(np.ceil(person.box[2:]).astype(int), (left + 1, top + 1))
    part = image[top:bottom, left:right]
    scale = min(1.0, _APPEARANCE_SIDE / max(part.shape[:2], default=1))
    size = max(round((right - left) * scale), 1), max(round((bottom - top) * scale), 1)
    crop = cv2.resize(part, size, interpolation=cv2.INTER_AREA)
    grid = np.full(labels[::-1], 255 if person.mask.values.size == 0 else 0, np.uint8)
    rows, columns = person.mask.values.shape
    grid[person.mask.top : person.mask.top + rows, person.mask.left : person.mask.left + columns] = person.mask.values
    across, down = labels[0] / width, labels[1] / height
    cells = grid[int(top * down) : max(int(np.ceil(bottom * down)), 1), int(left * across) :]
    cells = cells[:, : max(int(np.ceil(right * across)) - int(left * across), 1)]
    mask = cv2.resize(cells, size, interpolation=cv2.INTER_LINEAR).astype(np.float32) / 255
    keypoints = (person.keypoints - (left, top)) * scale
    return describe_clothes(crop.astype(np.uint8), mask, keypoints.astype(np.float32))


def _around(person: Detection, picture: tuple[int, int], labels: tuple[int, int]) -> CroppedMask:
    """The label cells of a person's box (labels and picture as width, height)."""
    scale = np.tile(np.array(labels) / picture, 2)
    left, top, right, bottom = np.clip(np.round(person.box * scale), 0, (*labels, *labels)).astype(int)
    return CroppedMask(int(top), int(left), np.full((bottom - top, right - left), 255, np.uint8))
