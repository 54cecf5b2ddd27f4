"""From frames to observations: the default networks and the user's own, one frame after the other."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from core_solver.perception.blazepose import BlazePose
from core_solver.perception.disparity import disparity_files, nearest_shape, open_disparity
from core_solver.perception.fusion import without_doubles
from core_solver.perception.multipose import MultiPose, Pose
from core_solver.perception.networks.declared import Declared, open_declared
from core_solver.perception.networks.merging import detect
from core_solver.perception.networks.people import Person
from core_solver.perception.observations import Detection, FrameInfo, FrameObservations
from core_solver.perception.store import ModelStore
from core_solver.progress import Progress
from core_solver.video import VideoClip

Image = NDArray[np.uint8]

_LABEL_LONG_SIDE = 384

_T = TypeVar("_T")


class DepthNetwork(Protocol):
    """What sees how far things are."""

    path: Path

    def __call__(self, image: Image) -> NDArray[np.float16]:
        """Disparity (h, w) in [0, 1], near = large, of a (H, W, 3) BGR picture."""
        ...


@dataclass(frozen=True)
class Networks:
    """What a frame is shown to.

    Attributes:
        people: finds people.
        body: looks at each of them.
        disparity_files: depth networks of one family in several shapes, of which the one nearest the video's shape is
            used; empty without depth.
        declared: the user's own, which take the place of the default ones.
    """

    people: MultiPose
    body: BlazePose
    disparity_files: tuple[Path, ...]
    declared: Declared = field(default_factory=Declared)

    def files_for(self, width: int, height: int) -> tuple[Path, ...]:
        """The files that decide what is seen in a video of this size."""
        uses_files = self.disparity_files and self.declared.depth is None
        depth = (nearest_shape(self.disparity_files, width / height),) if uses_files else ()
        return (self.people.path, self.body.path, *depth, *self.declared.files)

    def open_disparity(self, width: int, height: int) -> DepthNetwork | None:
        """The depth network for a video of this size, if there is one."""
        return self.declared.depth or open_disparity(self.disparity_files, width, height)


def load_networks(store: ModelStore, depth: Path | None) -> Networks:
    """Load the default networks, fetching them on first use.

    Args:
        store: where models lie.
        depth: an ONNX disparity network, or a folder with one in several shapes; None for what the store holds.

    Raises:
        ModelError: a network is not to be had, or is damaged.
    """
    files = store.files("disparity") if depth is None else disparity_files(depth)
    return Networks(
        MultiPose(store.require("movenet-multipose")),
        BlazePose(store.require("blazepose-full")),
        files,
    )


def with_declared(networks: Networks, named: Sequence[str | Path], store: ModelStore, device: str) -> Networks:
    """The same networks, but for the user's own in the place of some.

    Args:
        networks: the default ones.
        named: TOML files, or names in the catalogue of networks.
        store: where models lie.
        device: "auto", "cpu" or "cuda", for the user's own.

    Raises:
        ModelError: a declaration or a network is wrong.
    """
    return replace(networks, declared=open_declared(named, store, device)) if named else networks


def label_size(width: int, height: int) -> tuple[int, int]:
    """(width, height) of the grid on which people are labelled, in a picture of this size."""
    scale = min(_LABEL_LONG_SIDE / max(width, height), 1.0)
    return max(round(width * scale), 1), max(round(height * scale), 1)


def perceive(
    clip: VideoClip, networks: Networks, progress: Progress, positions: Sequence[int] | None = None
) -> Iterator[FrameObservations]:
    """Observe a clip frame by frame; memory does not grow with its length.

    Args:
        clip: the video.
        networks: what to look with.
        progress: shows one stage.
        positions: increasing positions in the clip's frame list; None for all.

    Raises:
        VideoError: a frame cannot be decoded.
        ModelError: the depth network does not fit.
    """
    positions = range(len(clip.frame_list)) if positions is None else positions
    disparity = networks.open_disparity(clip.width, clip.height)
    with progress.stage("See the people", len(positions)) as advance:
        # While BlazePose, which uses one core, looks at one frame, the next one is decoded and searched for people.
        for found in _one_ahead(_find_people(clip, positions, networks, disparity)):
            detections = _look_closer(found.image, found.people, networks.body)
            yield FrameObservations(found.frame, detections, found.disparity)
            advance(1)


def look_at(image: Image, poses: Sequence[Pose], body: BlazePose) -> tuple[Detection, ...]:
    """The people in a (H, W, 3) BGR picture, from where MoveNet found them."""
    return _look_closer(image, [Person(pose) for pose in poses], body)


def _look_closer(image: Image, people: Sequence[Person], body: BlazePose) -> tuple[Detection, ...]:
    picture = image.shape[1], image.shape[0]
    labels = label_size(*picture)
    detections = [detect(person, image, body, picture, labels) for person in people]
    return without_doubles([detection for detection in detections if detection is not None], labels)


@dataclass(frozen=True)
class _Found:
    frame: FrameInfo
    image: Image
    people: tuple[Person, ...]
    disparity: NDArray[np.float16] | None


def _find_people(
    clip: VideoClip, positions: Sequence[int], networks: Networks, disparity: DepthNetwork | None
) -> Iterator[_Found]:
    labels = label_size(clip.width, clip.height)
    for frame, image in clip.frames_at(positions):
        people = networks.declared.look(image, networks.people, labels)
        yield _Found(frame, image, people, disparity(image) if disparity else None)


def _one_ahead(items: Iterator[_T]) -> Iterator[_T]:
    """The same items, each made in another thread while the one before is used."""
    end = object()
    with ThreadPoolExecutor(max_workers=1) as worker:
        coming = worker.submit(next, items, end)
        while (item := coming.result()) is not end:
            coming = worker.submit(next, items, end)
            yield item  # type: ignore[misc]
