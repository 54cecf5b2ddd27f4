"""From a plan of who does what where to a finished scene."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core_solver.body.model import BodyModel
from core_solver.camera import Camera
from core_solver.evaluation.synthetic.actor import Actor, put_before_camera
from core_solver.evaluation.synthetic.noise import NoiseLevels
from core_solver.evaluation.synthetic.path import Script
from core_solver.evaluation.synthetic.perform import Performance, perform
from core_solver.evaluation.synthetic.physique import Physique
from core_solver.evaluation.synthetic.render import Grids, render_frames
from core_solver.evaluation.synthetic.replay import Replay, replay
from core_solver.evaluation.synthetic.spoil_pictures import spoil_frames
from core_solver.evaluation.synthetic.spoil_tracks import spoil_tracks
from core_solver.evaluation.synthetic.world import SeenTerrain, Terrain, View
from core_solver.evaluation.truth import SyntheticScene, Truth
from core_solver.optimise.posing import sole_rows
from core_solver.tracking.tracks import BACKGROUND, UNCLAIMED, Modalities, Track

Array = NDArray[np.float64]

_PRESENT = 0.05  # share of a body that must be seen for the person to count as being there
_SHORTEST_TRACK = 10  # frames: whom tracking finds in fewer it drops
_STILL_M = 1e-3  # a frame
_RESTING_M = 5e-3


@dataclass(frozen=True)
class Role:
    """Somebody and what they do.

    Attributes:
        physique: the body.
        motion: acted or replayed; a replay stands on level ground at height 0.
    """

    physique: Physique
    motion: Script | Replay

    def perform(self, terrain: Terrain, times: Array, rng: np.random.Generator) -> Performance:
        """The motion of this body at (T,) seconds."""
        if isinstance(self.motion, Replay):
            return replay(self.motion, self.physique, times)
        return perform(self.motion, self.physique, terrain, times, rng)


@dataclass(frozen=True)
class Plan:
    """A scene before it is acted.

    Attributes:
        name: of the scene.
        camera: intrinsics.
        view: where the camera stands.
        terrain: scenery.
        roles: people.
        times: (T,) seconds.
        levels: of the modalities' errors.
        grids: sizes of the modalities' pictures.
    """

    name: str
    camera: Camera
    view: View
    terrain: Terrain
    roles: tuple[Role, ...]
    times: Array
    levels: NoiseLevels
    grids: Grids


def act(plan: Plan, body: BodyModel, rng: np.random.Generator) -> list[Actor]:
    """The people of a plan in motion before the camera."""
    return [
        put_before_camera(role.perform(plan.terrain, plan.times, rng), role.physique, body, plan.view)
        for role in plan.roles
    ]


def stage(plan: Plan, body: BodyModel, rng: np.random.Generator) -> SyntheticScene:
    """Act, render and spoil a plan."""
    actors = act(plan, body, rng)
    scenery = SeenTerrain(plan.terrain, plan.view)
    keypoints = np.stack([actor.keypoints for actor in actors])
    frames = render_frames(actors, keypoints, scenery, plan.camera, plan.grids)
    pictures, sight = spoil_frames(frames, len(actors), plan.times, plan.grids, plan.levels, rng)
    tracks = spoil_tracks(actors, keypoints, sight, plan.camera, plan.times, plan.levels, rng)
    tracked = _long_enough(tracks)
    modalities = Modalities(
        times=plan.times,
        frames=np.arange(len(plan.times)),
        image_size=(plan.camera.width, plan.camera.height),
        tracks=tuple(replace(tracks[n], id=number) for number, n in enumerate(tracked, start=1)),
        labels=_relabelled(pictures.labels, tracked),
        disparity=pictures.disparity,
    )
    truth = _truth([actors[n] for n in tracked], sight.visible[tracked] > _PRESENT, scenery)
    return SyntheticScene(plan.name, body, plan.camera, modalities, truth)


def _long_enough(tracks: Sequence[Track]) -> list[int]:
    """People who were found often enough to become tracks; everybody if nobody was."""
    frames = min(_SHORTEST_TRACK, len(tracks[0].valid))
    return [n for n, track in enumerate(tracks) if track.valid.sum() >= frames] or list(range(len(tracks)))


def _relabelled(labels: NDArray[np.uint8], tracked: Sequence[int]) -> NDArray[np.uint8]:
    """Labels that count tracked people only; the others' pixels belong to nobody."""
    new = np.full(256, UNCLAIMED, np.uint8)
    new[BACKGROUND] = BACKGROUND
    for number, n in enumerate(tracked, start=1):
        new[n + 1] = number
    return new[labels]


def _truth(actors: Sequence[Actor], present: NDArray[np.bool_], scenery: SeenTerrain) -> Truth:
    body = actors[0].body
    rows = body.proxy[sole_rows(body)]
    soles = np.stack([actor.vertices(slice(None), rows.ravel()) for actor in actors])
    soles = soles.reshape(*soles.shape[:2], *rows.shape, 3)
    return Truth(
        joints=np.stack([actor.joints for actor in actors]),
        soles=soles,
        present=present,
        contacts=resting(soles, scenery),
        heights=np.array([actor.physique.height for actor in actors]),
        up=scenery.view.up,
        scenery=scenery,
    )


def resting(soles: Array, scenery: SeenTerrain) -> NDArray[np.bool_]:
    """Contacts (N, T, 2): a sole's lowest point is near the surface, and no point of it moves to a next frame."""
    near = np.abs(scenery.height_above(soles).min(axis=-1)) < _RESTING_M
    if soles.shape[1] == 1:
        return near
    still = np.linalg.norm(np.diff(soles, axis=1), axis=-1).max(axis=-1) < _STILL_M
    before = np.concatenate([still[:, :1], still], axis=1)
    after = np.concatenate([still, still[:, -1:]], axis=1)
    return near & (before | after)
