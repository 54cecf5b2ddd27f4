"""The modalities of a folder, frame by frame of the video and in its pixels."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core_solver.body.model import BodyModel
from core_solver.errors import UserError
from core_solver.perception.precomputed.depth import GivenDepth, read_depth, with_range
from core_solver.perception.precomputed.folder import SETTINGS_FILE, Folder, Source, open_folder
from core_solver.perception.precomputed.joints import GivenJoints, GivenPerson, read_joints, without_identities
from core_solver.perception.precomputed.masks import GivenMask, GivenMasks, read_masks
from core_solver.perception.precomputed.numbering import Counting, agreed_first, check_range, count_from
from core_solver.perception.precomputed.smpl import GivenPose, joint_pixels, read_smpl
from core_solver.perception.precomputed.smpl import without_identities as without_pose_identities
from core_solver.video import VideoClip, open_video

Size = tuple[int, int]

_SAME_SHAPE = 0.01  # of the aspect: sizes are whole pixels
_SAME_DEPTH_SHAPE = 0.05  # networks round their sides to multiples of 32
_MOST_OUTSIDE = 0.2  # of the confident joints
_CONFIDENT = 0.3
_NORMALISED = 2.0  # pixels; a person is larger than that


@dataclass(frozen=True)
class GivenModalities:
    """What a folder says about a video; frames are the video's, counted from 0, and pixels are its own.

    Attributes:
        folder: where it comes from.
        body: turns SMPL poses into landmarks.
        joints: people's joints; None where the folder has none.
        smpl: SMPL poses by frame; None likewise.
        depth: depth or disparity; None likewise.
        masks: people's masks; None likewise.
        first_depth: number of the video's first frame in the depth files.
        first_masks: the same in the masks.
        size: (width, height) of the video.
        notes: sentences about what was found and how it was understood.
    """

    folder: Folder
    body: BodyModel
    joints: GivenJoints | None
    smpl: Mapping[int, tuple[GivenPose, ...]] | None
    depth: GivenDepth | None
    masks: GivenMasks | None
    first_depth: int
    first_masks: int
    size: Size
    notes: tuple[str, ...]

    def people_at(self, frame: int) -> tuple[GivenPerson, ...] | None:
        """The people of a frame; None where nothing is known about it."""
        if self.joints is None:
            return None
        return self.joints.people.get(frame, None if self.joints.names_empty_frames else ())

    def poses_at(self, frame: int) -> tuple[GivenPose, ...]:
        """The SMPL poses of a frame."""
        return () if self.smpl is None else self.smpl.get(frame, ())

    def knows_masks_at(self, frame: int) -> bool:
        """Whether a frame's masks are given, be it that there are none in it."""
        return self.masks is not None and frame + self.first_masks in self.masks.numbers

    def masks_at(self, frame: int) -> tuple[GivenMask, ...]:
        """The masks of a frame; their ids mean something where `identities_from` says so."""
        if self.masks is None or not self.knows_masks_at(frame):
            return ()
        return self.masks.read(frame + self.first_masks)

    def disparity_at(self, frame: int) -> NDArray[np.float16] | None:
        """Normalised disparity of a frame, NaN where nothing is known; None where the folder has no depth.

        Raises:
            UserError: damaged, or of another size than the others.
        """
        if self.depth is None:
            return None
        number = frame + self.first_depth
        if number not in self.depth.planes.numbers:
            return np.full(self.depth.shape, np.nan, np.float16)
        plane = self.depth.read(number)
        if plane.shape != self.depth.shape:
            (height, width), (usual_height, usual_width) = plane.shape, self.depth.shape
            raise UserError(
                f"the depth of frame {number} in {self._depth_label} is {width}x{height}, others are "
                f"{usual_width}x{usual_height}: a clip's depth has one size"
            )
        return plane

    @cached_property
    def identities_from(self) -> str | None:
        """The modality that tells people apart over time: ids of two programs have nothing to do with each other."""
        if self.joints is not None and any(p.identity is not None for f in self.joints.people.values() for p in f):
            return "joints"
        if self.masks is not None and self.folder.masks is not None and self.folder.masks.identities:
            return "masks"
        if self.smpl is not None and any(p.identity is not None for f in self.smpl.values() for p in f):
            return "smpl"
        return None

    @property
    def depth_source(self) -> str | None:
        """How the take names where its depth comes from."""
        return None if self.depth is None else f"{self._depth_label} (precomputed)"

    @property
    def _depth_label(self) -> str:
        return self.folder.depth.label if self.folder.depth is not None else "depth"


def open_modalities(path: Path, clip: VideoClip, body: BodyModel) -> GivenModalities:
    """Read a folder of modalities for a video.

    Joints and SMPL poses are read at once, masks and depth frame by frame as they are wanted.

    Raises:
        UserError: nothing there, damaged, or made for another video.
    """
    folder, size = open_folder(path), (clip.width, clip.height)
    joints = read_joints(folder.joints.path) if folder.joints else None
    smpl = read_smpl(folder.smpl.path) if folder.smpl else None
    depth = read_depth(folder.depth.path, is_metric=folder.depth.is_metric) if folder.depth else None
    masks = read_masks(folder.masks.path) if folder.masks else None
    numbers = [
        joints.people.keys() if joints is not None else (),
        smpl.keys() if smpl is not None else (),
        depth.planes.numbers if depth is not None else (),
        masks.numbers if masks is not None else (),
    ]
    firsts, notes = _count_frames(folder, numbers, len(open_video(clip.path).frame_list))
    first_joints, first_smpl, first_depth, first_masks = firsts
    if joints is not None and folder.joints is not None:
        joints, scaling = _fit_joints(joints, folder.joints, first_joints, size)
        notes += (*joints.notes, *scaling)
    if smpl is not None and folder.smpl is not None:
        smpl = _fit_poses(smpl, folder.smpl, first_smpl, size, body)
    if depth is not None and folder.depth is not None:
        depth = _fit_depth(depth, folder.depth, [frame.index + first_depth for frame in clip.frame_list], size)
    if masks is not None and folder.masks is not None:
        notes += _require_shape(folder.masks, masks.size, size, _SAME_SHAPE)
    return GivenModalities(folder, body, joints, smpl, depth, masks, first_depth, first_masks, size, notes)


def _count_frames(
    folder: Folder, numbers: Sequence[Collection[int]], frame_count: int
) -> tuple[list[int], tuple[str, ...]]:
    """The number of the video's first frame in joints, SMPL poses, depth and masks, and what is to be said about it."""
    sources = (folder.joints, folder.smpl, folder.depth, folder.masks)
    countings = [
        Counting(source.first, certain=True) if source and source.first is not None else count_from(own, frame_count)
        for source, own in zip(sources, numbers, strict=True)
    ]
    firsts = agreed_first(countings)
    settled = {counting.first for counting in countings if counting.certain}
    notes = []
    for source, own, first, counting in zip(sources, numbers, firsts, countings, strict=True):
        if source is not None and own:
            beyond = check_range(own, first, frame_count, source.label)
            guess = (
                "" if counting.certain or settled == {first} else f" (a guess: `first` in {SETTINGS_FILE} settles it)"
            )
            ends = f", {beyond} beyond the video's end are not used" if beyond else ""
            notes.append(f"{source.label}: {len(own)} frames, counted from {first}{guess}{ends}.")
        elif source is not None:
            notes.append(f"{source.label}: nothing about any frame.")
    return firsts, tuple(notes)


def _fit_joints(joints: GivenJoints, source: Source, first: int, size: Size) -> tuple[GivenJoints, tuple[str, ...]]:
    """Joints by the video's frames, in its pixels."""
    own_size = source.size or joints.size or size
    notes = _require_shape(source, own_size, size, _SAME_SHAPE)
    factor = (np.array(size) / own_size).astype(np.float32)
    people = {
        number - first: tuple(replace(p, keypoints=p.keypoints * factor) for p in frame)
        for number, frame in joints.people.items()
    }
    _require_inside(people, size, source)
    fitted = replace(joints, people=people)
    return fitted if source.identities else without_identities(fitted), notes


def _fit_poses(
    smpl: Mapping[int, tuple[GivenPose, ...]], source: Source, first: int, size: Size, body: BodyModel
) -> Mapping[int, tuple[GivenPose, ...]]:
    """Poses by the video's frames, with the pixels of their joints."""
    own_size = source.size or size
    _require_shape(source, own_size, size, _SAME_SHAPE)
    factor = np.array(size) / own_size

    def fit(pose: GivenPose) -> GivenPose:
        points = joint_pixels(pose, body, own_size)
        if points is None:
            raise UserError(
                f"{source.label} does not say where its people are in the picture: it needs pj2d_org or cam"
            )
        return replace(pose, points=points * factor)

    fitted = {number - first: tuple(map(fit, poses)) for number, poses in smpl.items()}
    return fitted if source.identities else without_pose_identities(fitted)


def _fit_depth(depth: GivenDepth, source: Source, wanted: Sequence[int], size: Size) -> GivenDepth:
    """Depth that knows its range over the wanted frame numbers."""
    height, width = depth.planes.read(min(depth.planes.numbers)).shape
    _require_shape(source, (width, height), size, _SAME_DEPTH_SHAPE)
    return with_range(depth, [number for number in wanted if number in depth.planes.numbers])


def _require_shape(source: Source, own: Size, video: Size, tolerance: float) -> tuple[str, ...]:
    """A note if pictures are scaled.

    Raises:
        UserError: they have another shape than the video.
    """
    if own == video:
        return ()
    misfit = abs(np.log(own[0] * video[1] / (own[1] * video[0])))
    if misfit > tolerance and not source.stretch:
        raise UserError(
            f"{source.label} is {own[0]}x{own[1]}, the video {video[0]}x{video[1]}: these are different pictures "
            "(if they are the same, stretched, say stretch = true in modalities.toml)"
        )
    return (f"{source.label}: scaled from {own[0]}x{own[1]} to {video[0]}x{video[1]}.",)


def _require_inside(people: Mapping[int, tuple[GivenPerson, ...]], size: Size, source: Source) -> None:
    """Joints of a larger picture, or in units other than pixels, give themselves away."""
    seen = [p.keypoints[p.confidence > _CONFIDENT] for frame in people.values() for p in frame]
    points = np.concatenate([np.zeros((0, 2), np.float32), *seen])
    if len(points) == 0:
        return
    if np.abs(points).max() < _NORMALISED:
        raise UserError(f"the joints in {source.label} are not in pixels: write them without normalising")
    outside = np.mean(((points < 0) | (points > size)).any(axis=1))
    if outside > _MOST_OUTSIDE:
        raise UserError(
            f"{outside:.0%} of the joints in {source.label} lie outside the {size[0]}x{size[1]} video: if they were "
            "made on a larger picture, say size = [width, height] in modalities.toml"
        )
