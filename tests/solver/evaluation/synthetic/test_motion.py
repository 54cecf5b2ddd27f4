"""Acted motion: feet that stand, legs that reach, people who jump, climb and grow up."""

import numpy as np
import pytest

from core_solver.body import BodyModel, kinematics
from core_solver.evaluation.synthetic.path import GRAVITY, Move, Script, root_path
from core_solver.evaluation.synthetic.perform import Performance, perform
from core_solver.evaluation.synthetic.physique import Physique, draw_physique, physique
from core_solver.evaluation.synthetic.world import Block, Terrain
from core_solver.geometry import rotvec_from_matrix
from core_solver.optimise.posing import sole_rows

RATE = 30
STEPS = (
    *(Block((1.0 + 0.4 * n, 0.0), (0.4, 2.0), 0.0, 0.15 * (n + 1)) for n in range(3)),
    Block((3.0, 0.0), (2.0, 2.0), 0.0, 0.6),
)
TRICKS = (Move(1.0, gesture="wave"), Move(1.0, crouch=0.4), Move(1.0, turn=1.5), Move(1.0, gesture="dance"))
PLACES = {
    "flat": (Terrain(), Script((0, 0), 0.3, (Move(2.0, 1.2), Move(1.0, 0.5, 1.5), Move(1.0)))),
    "slope": (Terrain((0.12, -0.05)), Script((0, 0), 0.3, (Move(2.0, 1.0), Move(1.0, 0.5, -1.0), Move(1.0)))),
    "steps": (Terrain(blocks=STEPS), Script((0, 0), 0.0, (Move(5.0, 0.7),))),
    "spot": (Terrain(), Script((0, 0), 0.0, TRICKS)),
}  # fmt: skip


def soles_of(performance: Performance, person: Physique, body: BodyModel) -> np.ndarray:
    """(T, 2, S, 3) world."""
    rest = body.rest_joints(person.betas)
    rotations, positions = kinematics.pose_joints(rotvec_from_matrix(performance.rotations), rest)
    rows = body.proxy[sole_rows(body)]
    points = kinematics.skin(
        body.rest_vertices(person.betas)[rows.ravel()], body.weights[rows.ravel()], rotations, positions, rest
    )
    points = person.scale * (points - rest[0]) + performance.pelvis[:, None]
    return points.reshape(len(points), *rows.shape, 3)


@pytest.fixture(scope="module", params=sorted(PLACES))
def acted(request: pytest.FixtureRequest, stick: BodyModel) -> tuple[Terrain, np.ndarray, Performance]:
    terrain, script = PLACES[request.param]
    rng = np.random.default_rng(1)
    person = draw_physique(rng, stick, 1.3 if request.param == "slope" else 1.75)
    performance = perform(script, person, terrain, np.arange(110) / RATE, rng)
    return terrain, soles_of(performance, person, stick), performance


def test_a_foot_either_moves_or_stands_firmly_on_the_surface(acted: tuple) -> None:
    terrain, soles, _ = acted
    above = soles[..., 2] - terrain.height(soles[..., :2])
    step = np.linalg.norm(np.diff(soles, axis=0), axis=-1).max(axis=-1)
    still = step < 1e-3
    assert still.mean() > 0.4
    assert np.abs(above[1:].min(axis=-1)[still]).max() < 5e-3
    # Whatever is still is so to rounding; there is nothing that creeps.
    assert np.median(step[still]) < 1e-6


def test_nobody_sinks_into_the_ground(acted: tuple) -> None:
    terrain, soles, _ = acted
    assert (soles[..., 2] - terrain.height(soles[..., :2])).min() > -0.02


def test_a_walker_always_has_a_foot_on_the_ground(acted: tuple) -> None:
    terrain, soles, _ = acted
    lowest = (soles[..., 2] - terrain.height(soles[..., :2])).min(axis=(1, 2))
    assert lowest.max() < 0.03


def test_the_body_moves_smoothly(acted: tuple) -> None:
    _, _, performance = acted
    acceleration = np.diff(performance.pelvis, n=2, axis=0) * RATE**2
    assert np.abs(acceleration[:, :2]).max() < 6
    assert np.abs(acceleration[:, 2]).max() < 40
    turns = performance.rotations[:-1].swapaxes(-1, -2) @ performance.rotations[1:]
    angles = np.linalg.norm(rotvec_from_matrix(turns), axis=-1)
    assert np.degrees(angles).max() < 50
    assert np.degrees(np.quantile(angles, 0.99)) < 22


def test_climbing_ends_on_the_platform(stick: BodyModel) -> None:
    terrain, script = PLACES["steps"]
    rng = np.random.default_rng(1)
    person = draw_physique(rng, stick, 1.75)
    pelvis = perform(script, person, terrain, np.arange(110) / RATE, rng).pelvis
    assert pelvis[-1, 2] - pelvis[0, 2] == pytest.approx(0.6, abs=0.08)


def test_a_jump_is_a_flight_under_gravity(stick: BodyModel) -> None:
    air = 0.4
    rng = np.random.default_rng(0)
    person = draw_physique(rng, stick, 1.7)
    performance = perform(
        Script((0, 0), 0, (Move(1.0), Move(1.2, jumps=air))), person, Terrain(), np.arange(90) / RATE, rng
    )
    lowest = soles_of(performance, person, stick)[..., 2].min(axis=(1, 2))
    flying = lowest > 5e-3
    assert flying.sum() / RATE == pytest.approx(air, abs=2.5 / RATE)
    assert lowest.max() == pytest.approx(GRAVITY * air**2 / 8, rel=0.15)


def test_the_path_keeps_to_its_moves() -> None:
    path = root_path(Script((1, 2), np.pi / 2, (Move(3.0, 1.0),)), 3.0)
    middle = path.at(path.position, np.array([1.0, 2.0]))
    np.testing.assert_allclose(middle[1] - middle[0], [0, 1], atol=1e-9)
    np.testing.assert_allclose(path.at(path.position, 0.0), [1, 2], atol=1e-9)


@pytest.mark.parametrize("height", [0.95, 1.3, 1.6, 1.95])
def test_people_have_the_stature_asked_for(stick: BodyModel, height: float) -> None:
    person = draw_physique(np.random.default_rng(0), stick, height)
    assert person.scale * stick.height(person.betas) == pytest.approx(height)
    assert np.ptp(person.joints[:, 1]) < height


def test_a_body_whose_betas_cannot_grow_is_scaled(stick: BodyModel) -> None:
    stiff = type(stick)(**{**vars_of(stick), "shape_directions": np.zeros_like(stick.shape_directions)})
    child = physique(stiff, 1.1, np.zeros(10))
    assert child.scale == pytest.approx(1.1 / stick.height(np.zeros(10)))
    assert child.height == 1.1


def vars_of(body: BodyModel) -> dict:
    return {name: getattr(body, name) for name in BodyModel.__dataclass_fields__}
