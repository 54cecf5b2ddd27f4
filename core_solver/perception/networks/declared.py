"""All declared networks together: which one does what, and in which order they look."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core_solver.body import load_body
from core_solver.errors import ModelError
from core_solver.perception.multipose import Pose
from core_solver.perception.networks.catalogue import read_declaration
from core_solver.perception.networks.depth import DeclaredDepth
from core_solver.perception.networks.kinds import View
from core_solver.perception.networks.people import BodyRegressor, CropPoses, MaskFinder, PeopleFinder, Person
from core_solver.perception.networks.spec import NetworkSpec
from core_solver.perception.store import ModelStore

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Declared:
    """The user's networks; what is None is left to the default ones.

    Attributes:
        files: declarations, networks and bodies: whatever decides what is seen.
        finder: finds people.
        poses: looks at each person's keypoints.
        masks: sees which pixels are whose.
        depth: sees how far things are.
        bodies: sees how people are posed in space.
    """

    files: tuple[Path, ...] = ()
    finder: PeopleFinder | None = None
    poses: CropPoses | None = None
    masks: MaskFinder | None = None
    depth: DeclaredDepth | None = None
    bodies: BodyRegressor | None = None

    def look(
        self, image: Image, find: Callable[[Image], tuple[Pose, ...]], labels: tuple[int, int]
    ) -> tuple[Person, ...]:
        """The people in a (H, W, 3) BGR picture and what the declared networks say about them.

        Args:
            image: the picture.
            find: the default finder of people, asked where none is declared.
            labels: (width, height) of the label grid.

        Raises:
            ModelError: a network fails.
        """
        people = self.finder(image) if self.finder else tuple(Person(pose) for pose in find(image))
        people = self.poses(image, people) if self.poses else people
        people = self.masks(image, people, labels) if self.masks else people
        return self.bodies(image, people) if self.bodies else people

    def field_of_view(self, images: Iterable[Image]) -> float | None:
        """Degrees along the longer side as the depth network sees it, the median over pictures (H, W, 3) BGR.

        None where no such network is declared, or it does not say.

        Raises:
            ModelError: the network fails.
        """
        if self.depth is None:
            return None
        views = [self.depth.look(image).field_of_view for image in images]
        known = [view for view in views if view is not None]
        return float(np.median(known)) if known else None


def open_declared(named: Sequence[str | Path], store: ModelStore, device: str) -> Declared:
    """Open declared networks.

    Args:
        named: TOML files, or names in the catalogue.
        store: where files of catalogue entries and the open body lie.
        device: "auto", "cpu" or "cuda".

    Raises:
        ModelError: a declaration or a file is wrong, or two networks would do the same.
    """
    specs = [read_declaration(name, store) for name in named]
    chosen: dict[str, NetworkSpec] = {}
    for spec in specs:
        part = _part(spec)
        if part in chosen:
            raise ModelError(f"{chosen[part].toml.name} and {spec.toml.name} both are {part}: give one of them")
        chosen[part] = spec
    finder, poses, masks, depth, bodies = (chosen.get(part) for part in _PARTS)
    body_file = store.require("open-body") if bodies else None
    files = [file for spec in specs for file in (spec.toml, spec.file)]
    return Declared(
        files=tuple(files if body_file is None else [*files, body_file]),
        finder=PeopleFinder(finder, device) if finder else None,
        poses=CropPoses(poses, device) if poses else None,
        masks=MaskFinder(masks, device) if masks else None,
        depth=DeclaredDepth(depth, device) if depth else None,
        bodies=BodyRegressor(bodies, device, load_body(body_file)) if bodies and body_file else None,
    )


_PARTS = ("finders of people", "poses of people's crops", "masks", "depth", "SMPL regressors")


def _part(spec: NetworkSpec) -> str:
    finder, poses, masks, depth, bodies = _PARTS
    if spec.kind.task == "pose":
        return finder if spec.view is View.PICTURE else poses
    return {"masks": masks, "depth": depth, "smpl": bodies}[spec.kind.task]
