"""The benchmark's suites: which scenes there are for a seed."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import numpy as np

from core_solver.body.model import BodyModel
from core_solver.camera import camera_from_fov
from core_solver.evaluation.synthetic.casting import ACTS, TERRAINS, Shot, draw_roles, draw_shot, draw_terrain
from core_solver.evaluation.synthetic.noise import NoiseLevels
from core_solver.evaluation.synthetic.render import Grids
from core_solver.evaluation.synthetic.stage import Plan, stage
from core_solver.evaluation.synthetic.world import Terrain, look
from core_solver.evaluation.truth import SyntheticScene

_LABELS, _DISPARITY = 320, 256  # longer sides of the grids
_SMALL_LABELS, _SMALL_DISPARITY = 192, 128


@dataclass(frozen=True)
class Suite:
    """A collection of scenes.

    Attributes:
        name: for the command line.
        scenes: a seed gives this many.
        description: one line for people.
        draw: makes one scene's plan from its random numbers and its number.
    """

    name: str
    scenes: int
    description: str
    draw: Callable[[np.random.Generator, int, BodyModel], Plan]


def suite_scenes(suite: str, seed: int, body: BodyModel, motions: Path | None = None) -> Iterator[SyntheticScene]:
    """The scenes of a suite for one seed; the same arguments give the same arrays.

    Args:
        suite: name of one of SUITES.
        seed: not negative.
        body: body model.
        motions: folder of BVH files; without one all motion is procedural.

    Raises:
        KeyError: no such suite.
    """
    for number in range(SUITES[suite].scenes):
        rng = scene_generator(suite, seed, number)
        yield stage(SUITES[suite].draw(rng, number, body), body, rng)


def scene_generator(suite: str, seed: int, number: int) -> np.random.Generator:
    """Random numbers of one scene, independent of all other scenes'."""
    return np.random.default_rng([crc32(suite.encode()), seed, number])


def sized_scene(frames: int, people: int, seed: int, body: BodyModel) -> SyntheticScene:
    """A plain scene of any size for measurements of speed: people on a flat floor, small pictures."""
    rng = scene_generator("sized", seed, people)
    camera = camera_from_fov(1280, 720, 65, "truth")
    shot = Shot(camera, look((0, 0, 2.2), (0, 5.5, 0.9), 0.02), 4.0, 8.5)
    times = np.arange(frames) / 30
    acts = tuple(("walk", "stand", "talk", "dance", "wave")[n % 5] for n in range(people))
    children = tuple(n % 3 == 1 for n in range(people))
    roles = draw_roles(rng, body, shot, Terrain(), float(times[-1]), children, acts)
    grids = _grids(1280, 720, _SMALL_LABELS, _SMALL_DISPARITY)
    return stage(Plan("sized", camera, shot.view, Terrain(), roles, times, NoiseLevels(), grids), body, rng)


def _grids(width: int, height: int, labels: int, disparity: int) -> Grids:
    longer = max(width, height)
    sizes = [(round(width * side / longer), round(height * side / longer)) for side in (labels, disparity)]
    return Grids(*sizes)


def _standard(rng: np.random.Generator, number: int, body: BodyModel) -> Plan:
    people = int(rng.integers(1, 6)) if number == 0 else int(rng.integers(2, 5))
    return _drawn(rng, f"standard-{number}", body, people, ACTS, TERRAINS, NoiseLevels())


def _ablation(rng: np.random.Generator, number: int, body: BodyModel) -> Plan:
    acts = ("walk", "cross", "talk", "jump", "dance")
    return _drawn(rng, f"ablation-{number}", body, int(rng.integers(2, 4)), acts, ("flat", "boxes"), NoiseLevels())


def _stress(rng: np.random.Generator, number: int, body: BodyModel) -> Plan:
    if number == 1:
        return _drawn(rng, "stress-moment", body, 1, ("stand",), ("flat",), NoiseLevels(), frames=1)
    if number == 2:
        return _drawn(rng, "stress-still", body, 1, ("stand",), ("flat",), NoiseLevels())
    acts = ("cross", "cross", "enter", "leave", "jump")
    return _drawn(rng, "stress-crowd", body, 5, acts, ("stairs",), NoiseLevels().times(1.6))


def _drawn(
    rng: np.random.Generator, name: str, body: BodyModel, people: int, acts: tuple[str, ...],
    terrains: tuple[str, ...], levels: NoiseLevels, frames: int = 0,
) -> Plan:  # fmt: skip
    shot = draw_shot(rng)
    terrain = draw_terrain(rng, terrains[rng.integers(len(terrains))], shot)
    rate = float(rng.choice([25.0, 30.0]))
    times = np.arange(frames or int(rng.integers(75, 91))) / rate
    children = tuple(rng.random(people) < 0.35)
    chosen = tuple(str(act) for act in rng.choice(acts, size=people, replace=people > len(acts)))
    roles = draw_roles(rng, body, shot, terrain, float(times[-1]), children, chosen)
    grids = _grids(shot.camera.width, shot.camera.height, _LABELS, _DISPARITY)
    return Plan(name, shot.camera, shot.view, terrain, roles, times, levels, grids)


SUITES = {
    suite.name: suite
    for suite in (
        Suite("standard", 2, "1 to 5 adults and children, all motions and sceneries, errors as measured", _standard),
        Suite("ablation", 1, "2 or 3 people on a flat floor or boxes, errors as measured", _ablation),
        Suite(
            "stress",
            3,
            "5 people who cross, enter and leave on stairs under strong errors; one frame; one still person",
            _stress,
        ),
    )
}
