"""The benchmark's suites: which scenes there are for a seed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import numpy as np

from core_solver.body.model import BodyModel
from core_solver.camera import camera_from_fov
from core_solver.evaluation.synthetic.casting import ACTS, Setting, circling_roles, draw_roles
from core_solver.evaluation.synthetic.noise import NoiseLevels
from core_solver.evaluation.synthetic.recording import Recording, read_recordings
from core_solver.evaluation.synthetic.render import Grids
from core_solver.evaluation.synthetic.scenery import TERRAINS, draw_shot, draw_terrain
from core_solver.evaluation.synthetic.stage import Plan, stage
from core_solver.evaluation.synthetic.world import Terrain, look
from core_solver.evaluation.truth import SyntheticScene

_CHILDREN = 0.35  # of the people
_SHORTEST_S = 2.0  # a single picture is the first of a short clip
_LABELS, _DISPARITY = 320, 256  # longer sides of the grids
_SMALL_LABELS, _SMALL_DISPARITY = 192, 128


@dataclass(frozen=True)
class Kind:
    """What a scene is drawn from.

    Attributes:
        name: unique within its suite.
        people: fewest and most.
        acts: of which everybody gets another one as far as there are enough.
        terrains: of which there is one; numbers of people and terrains take turns from seed to seed.
        errors: how much larger than measured the modalities' errors are.
        frames: fewest and most.
        with_adult: the first is an adult if all would be children: their world looks like one of adults, only smaller,
            and no camera can tell.
    """

    name: str
    people: tuple[int, int]
    acts: tuple[str, ...]
    terrains: tuple[str, ...]
    errors: float = 1.0
    frames: tuple[int, int] = (75, 90)
    with_adult: bool = True


@dataclass(frozen=True)
class Suite:
    """A collection of scenes.

    Attributes:
        name: for the command line.
        description: one line for people.
        kinds: one for each scene of a seed.
    """

    name: str
    description: str
    kinds: tuple[Kind, ...]


SUITES = {
    suite.name: suite
    for suite in (
        Suite(
            "standard",
            "two scenes of 1 to 5 people, children with adults, all motions and sceneries, errors as on real clips",
            (Kind("one", (1, 4), ACTS, TERRAINS), Kind("two", (2, 5), ACTS, TERRAINS)),
        ),
        Suite(
            "ablation",
            "one scene of 2 or 3 people on a floor with or without boxes, errors as measured on real clips",
            (Kind("one", (2, 3), ("walk", "cross", "talk", "jump", "dance"), ("flat", "boxes")),),
        ),
        Suite(
            "stress",
            "five people who cross, enter, leave and jump on stairs, errors 1.6 times as large; one picture; one still",
            (
                Kind("crowd", (5, 5), ("cross", "cross", "enter", "leave", "jump"), ("stairs",), 1.6, (90, 110)),
                Kind("picture", (1, 1), ("stand",), ("flat",), frames=(1, 1), with_adult=False),
                Kind("still", (1, 1), ("stand",), TERRAINS[:2], with_adult=False),
            ),
        ),
    )
}


def suite_scenes(suite: str, seed: int, body: BodyModel, motions: Path | None = None) -> Iterator[SyntheticScene]:
    """The scenes of a suite for one seed; the same arguments give the same arrays.

    Args:
        suite: name of one of SUITES.
        seed: not negative.
        body: body model.
        motions: folder of BVH files, which then move most people on level ground; without one all motion is procedural.

    Raises:
        KeyError: no such suite.
        MotionFileError: the folder holds no usable BVH file.
    """
    for plan, rng in suite_plans(suite, seed, body, motions):
        yield stage(plan, body, rng)


def suite_plans(
    suite: str, seed: int, body: BodyModel, motions: Path | None = None
) -> Iterator[tuple[Plan, np.random.Generator]]:
    """What `suite_scenes` stages, before it is acted, and the random numbers to act it with."""
    recordings = read_recordings(motions) if motions else ()
    for number, kind in enumerate(SUITES[suite].kinds):
        rng = _generator(suite, seed, number)
        yield _draw_plan(rng, kind, seed + 2 * number, body, recordings), rng


def sized_scene(frames: int, people: int, seed: int, body: BodyModel) -> SyntheticScene:
    """A plain scene of any size for measurements of speed: people walk in circles on a flat floor; small pictures.

    Args:
        frames: T, at 30 a second.
        people: N; more than about 20 do not fit into the picture.
        seed: not negative.
        body: body model.
    """
    rng = _generator("sized", seed, people)
    times = np.arange(frames) / 30
    plan = Plan(
        name=f"sized-{frames}x{people}",
        camera=camera_from_fov(1280, 720, 65, "truth"),
        view=look((0, 0, 2.4), (0, 6.0, 0.9), 0.02),
        terrain=Terrain(),
        roles=circling_roles(rng, body, people, float(times[-1])),
        times=times,
        levels=NoiseLevels(),
        grids=_grids((1280, 720), _SMALL_LABELS, _SMALL_DISPARITY),
    )
    return stage(plan, body, rng)


def _generator(suite: str, seed: int, number: int) -> np.random.Generator:
    """Random numbers of one scene, independent of all other scenes'."""
    return np.random.default_rng([crc32(suite.encode()), seed, number])


def _draw_plan(
    rng: np.random.Generator, kind: Kind, turn: int, body: BodyModel, recordings: Sequence[Recording]
) -> Plan:
    shot = draw_shot(rng)
    terrain = draw_terrain(rng, kind.terrains[turn % len(kind.terrains)], shot)
    people = kind.people[0] + turn % (kind.people[1] - kind.people[0] + 1)
    times = np.arange(rng.integers(kind.frames[0], kind.frames[1] + 1)) / float(rng.choice([25.0, 30.0]))
    setting = Setting(shot, terrain, max(float(times[-1]), _SHORTEST_S), tuple(recordings))
    children = [bool(child) for child in rng.random(people) < _CHILDREN]
    if all(children) and kind.with_adult:
        children[0] = False
    acts = [str(act) for act in rng.choice(kind.acts, size=people, replace=people > len(kind.acts))]
    return Plan(
        name=kind.name,
        camera=shot.camera,
        view=shot.view,
        terrain=terrain,
        roles=draw_roles(rng, body, setting, children, acts),
        times=times,
        levels=NoiseLevels().times(kind.errors),
        grids=_grids((shot.camera.width, shot.camera.height), _LABELS, _DISPARITY),
    )


def _grids(image: tuple[int, int], labels: int, disparity: int) -> Grids:
    def size(side: int) -> tuple[int, int]:
        return round(image[0] * side / max(image)), round(image[1] * side / max(image))

    return Grids(size(labels), size(disparity))
