"""Statures and ground from true poses: what this fit adds, apart from how well poses are found."""

from dataclasses import replace

import numpy as np
import pytest

from core_solver.energy.weights import Weights
from core_solver.geometry import matrix_from_rotvec
from core_solver.optimise.scale_ground import ScaleGround, ScaleProblem, fit_scale_ground
from core_solver.scene.edges import UprightCues
from core_solver.scene.sampling import BodyDepth, FloorSamples

CAMERA_HEIGHT, STATURE, FRAMES = 2.2, 1.70, 30


def tilted_up(degrees: float = 17.0) -> np.ndarray:
    angle = np.radians(degrees)
    up = np.array([0.05, -np.cos(angle), -np.sin(angle)])
    return up / np.linalg.norm(up)


def problem_of(
    people: list[tuple[float, float, float]], *, up: np.ndarray | None = None, levels=None, with_depth=True, seed=0
) -> ScaleProblem:
    """People (scale, metres to the right, metres away) of 1.70 m times scale who pace about on a tilted floor."""
    rng = np.random.default_rng(seed)
    up = tilted_up() if up is None else up
    right = np.cross(up, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    frame = np.stack([right, up, np.cross(right, up)], axis=1)  # columns: right, up, away or near
    if frame[2, 2] < 0:
        frame[:, 2] *= -1
    soles, log_depth = [], []
    for index, (scale, x, z) in enumerate(people):
        level = 0.0 if levels is None else levels[index]
        place = np.array([x, level - CAMERA_HEIGHT, z]) + rng.normal(size=(FRAMES, 2, 3)) * (0.3, 0.005, 0.3)
        soles.append(place @ frame.T / scale)
        body = np.array([x, 0.9 * scale + level - CAMERA_HEIGHT, z]) @ frame.T
        log_depth.append(np.full(FRAMES, np.log(body[2] / scale)))
    far, gap = 1 / 30, 1 / 1.5 - 1 / 30
    depth = np.exp(np.array(log_depth)) * np.array([p[0] for p in people])[:, None]
    disparity = (1 / depth - far) / gap if with_depth else np.zeros_like(depth)
    shape = (len(people), FRAMES)
    return ScaleProblem(
        soles=np.array(soles),
        planted=np.full((*shape, 2), 0.9),
        balance=np.tile(up, (len(people), 1)),
        heights=np.full(len(people), STATURE),
        log_depth=np.array(log_depth),
        body_depth=BodyDepth(np.ones((*shape, 1), bool), np.zeros((*shape, 1), np.float32), disparity, np.ones(shape)),
        floor=FloorSamples(np.zeros((0, 3)), np.zeros(0), np.zeros(0, int)),
    )


def degrees_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))


def solve(problem: ScaleProblem) -> ScaleGround:
    return fit_scale_ground(problem, Weights())


@pytest.mark.parametrize("with_depth", [True, False])
def test_adults_on_one_ground_get_their_sizes_and_the_ground_its_tilt(with_depth):
    people = [(1.0, -1.0, 5.0), (0.93, 1.0, 6.5), (1.05, 0.0, 8.0)]
    answer = solve(problem_of(people, with_depth=with_depth))
    relative = answer.scales / answer.scales[0]
    np.testing.assert_allclose(relative, [1.0, 0.93, 1.05], rtol=0.03)
    assert degrees_between(answer.up, tilted_up()) < 1
    assert answer.offset == pytest.approx(CAMERA_HEIGHT, rel=0.05)


@pytest.mark.parametrize(("scale", "with_depth"), [(0.7, True), (0.7, False), (0.8, False)])
def test_a_child_beside_an_adult_is_no_far_adult(scale, with_depth):
    answer = solve(problem_of([(1.0, -1.0, 5.0), (scale, 1.0, 6.0)], with_depth=with_depth))
    assert answer.scales[1] / answer.scales[0] == pytest.approx(scale, rel=0.12)
    assert degrees_between(answer.up, tilted_up()) < 3
    assert answer.offset == pytest.approx(CAMERA_HEIGHT, rel=0.15)


def test_a_family_is_not_taken_for_giants():
    """One adult and two children on one floor: the sum of statures asks for a world a third too large."""
    statures = np.array([1.65, 1.0, 1.2])
    people = [(s / STATURE, x, z) for s, x, z in zip(statures, (-1.0, 0.5, 1.2), (5.0, 5.5, 6.5), strict=True)]
    answer = solve(problem_of(people))
    np.testing.assert_allclose(answer.scales * STATURE, statures, rtol=0.12)
    assert answer.offset == pytest.approx(CAMERA_HEIGHT, rel=0.12)
    np.testing.assert_allclose(answer.levels, 0, atol=0.1)


def test_two_children_alone_are_taken_for_what_is_likelier():
    """Without an adult beside them nobody can tell: the answer must at least be one of people's sizes."""
    answer = solve(problem_of([(1.0 / STATURE, -1.0, 5.0), (1.2 / STATURE, 1.0, 6.0)]))
    heights = answer.scales * STATURE
    assert heights[1] / heights[0] == pytest.approx(1.2, rel=0.1)
    assert ((heights > 0.9) & (heights < 1.9)).all()


def test_a_far_end_beyond_all_measure_stays_a_number():
    """Statures that err a little bend the disparity's law, and its best far end lies behind infinity."""
    problem = problem_of([(1.0, -1.0, 5.0), (0.7, 1.0, 6.0)])
    answer = solve(problem)
    assert 1 / answer.inverse_far < 1e4
    assert np.isfinite(np.log([answer.inverse_far, answer.inverse_gap])).all()


@pytest.mark.parametrize("tilt", [-10.0, 0.0, 35.0])
def test_the_ground_is_found_for_a_camera_tilted_either_way(tilt):
    up = tilted_up(tilt)
    answer = solve(problem_of([(1.0, -1.0, 5.0), (0.95, 1.0, 7.0)], up=up))
    assert degrees_between(answer.up, up) < 3


def test_the_ground_reaches_from_near_to_far():
    answer = solve(problem_of([(1.0, -1.0, 4.0), (1.0, 2.0, 45.0)]))
    assert answer.scales[1] / answer.scales[0] == pytest.approx(1, rel=0.1)
    assert degrees_between(answer.up, tilted_up()) < 3


def test_one_person_alone_gets_the_priors_height():
    for scale in (0.6, 1.0, 1.4):
        answer = solve(problem_of([(scale, 0.0, 5.0)]))
        assert answer.scales[0] * STATURE == pytest.approx(Weights().height_mean_m, rel=0.02)


def test_the_depth_range_explains_the_disparity():
    problem = problem_of([(1.0, -1.0, 3.0), (1.0, 1.0, 5.0), (0.95, 0.0, 9.0)])
    answer = solve(problem)
    depth = 1 / (answer.inverse_far + answer.inverse_gap * problem.body_depth.mean_disparity)
    truth = answer.scales[:, None] * np.exp(problem.log_depth)
    np.testing.assert_allclose(depth, truth, rtol=0.05)


def test_somebody_on_a_step_does_not_drag_the_others():
    people = [(1.0, -1.0, 5.0), (1.0, 1.0, 5.5), (0.97, 0.3, 6.0), (1.03, -0.5, 6.5)]
    flat = solve(problem_of(people))
    stepped = solve(problem_of(people, levels=[0, 0, 0.2, 0]))
    assert degrees_between(stepped.up, tilted_up()) < 3
    assert stepped.offset == pytest.approx(flat.offset, rel=0.05)
    others = [0, 1, 3]
    np.testing.assert_allclose(
        stepped.scales[others] / stepped.scales[0], flat.scales[others] / flat.scales[0], rtol=0.04
    )


def test_one_wild_frame_does_not_lift_the_ground():
    problem = problem_of([(1.0, -1.0, 5.0), (0.95, 1.0, 6.0)])
    soles = problem.soles.copy()
    soles[0, 10] += 0.5 * tilted_up()
    answer, calm = solve(replace(problem, soles=soles)), solve(problem)
    assert answer.offset == pytest.approx(calm.offset, rel=0.03)
    assert degrees_between(answer.up, calm.up) < 1.5


def test_a_raised_still_foot_is_not_the_ground():
    problem = problem_of([(1.0, -1.0, 5.0), (0.95, 1.0, 6.0)])
    soles = problem.soles.copy()
    soles[:, :, 1] += 0.4 * tilted_up()
    answer, calm = solve(replace(problem, soles=soles)), solve(problem)
    assert answer.offset == pytest.approx(calm.offset, rel=0.03)


def test_no_planted_foot_is_finite_and_keeps_the_balance():
    problem = problem_of([(1.0, -1.0, 5.0), (0.95, 1.0, 6.0)])
    answer = solve(replace(problem, planted=np.zeros_like(problem.planted)))
    assert np.isfinite([*answer.scales, *answer.up, answer.offset, *answer.levels]).all()
    assert degrees_between(answer.up, tilted_up()) < 5


def test_knowing_nothing_at_all_is_finite_and_level():
    problem = problem_of([(1.0, -1.0, 5.0), (0.95, 1.0, 6.0)], with_depth=False)
    blind = replace(
        problem, planted=problem.planted * 0, balance=problem.balance * 0,
        body_depth=replace(problem.body_depth, weight=problem.body_depth.weight * 0),
    )  # fmt: skip
    answer = solve(blind)
    assert np.isfinite([*answer.scales, *answer.up, answer.offset, *answer.levels]).all()
    assert degrees_between(answer.up, np.array([0.0, -1.0, 0.0])) < 1
    np.testing.assert_allclose(answer.scales * STATURE, Weights().height_mean_m, rtol=0.01)


def test_a_camera_that_looks_steeply_down_is_believed_to_do_so():
    """The prior of a level camera must give way to a person's balance."""
    problem = problem_of([(1.0, 0.0, 5.0)], up=tilted_up(60.0))
    up = solve(problem).up
    assert np.linalg.norm(up) == pytest.approx(1)
    assert degrees_between(up, tilted_up(60.0)) < 20


def test_steps_beyond_all_measure_stay_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """An optimiser tries wild values on its way: they must cost much and not end the solve."""
    import core_solver.optimise.scale_ground as module

    seen = []

    def wild(residuals, x, args, **_options):
        seen.extend(np.isfinite(residuals(x * 0 + far, *args)).all() for far in (900.0, -900.0))
        return original(residuals, x, args=args, **_options)

    original = module.least_squares
    monkeypatch.setattr(module, "least_squares", wild)
    answer = solve(problem_of([(1.0, -1.0, 5.0), (0.95, 1.0, 6.0)]))
    assert len(seen) >= 2
    assert all(seen)
    assert np.isfinite(answer.scales).all()


def test_who_stands_on_a_roof_makes_nobody_a_child():
    """The depth map shows the roof about the feet of the one and the grass about those of the other."""
    problem = problem_of([(1.0, -1.0, 8.0), (0.97, 1.0, 7.0)], levels=[1.7, 0.0])
    rng = np.random.default_rng(4)
    rays, disparities, people = [], [], []
    for n, scale in enumerate((1.0, 0.97)):
        soles = scale * problem.soles[n].reshape(-1, 3)
        rays.append(soles / soles[:, 2:])
        disparities.append((1 / soles[:, 2] - 1 / 30) / (1 / 1.5 - 1 / 30) + rng.normal(size=len(soles)) * 0.002)
        people.append(np.full(len(soles), n))
    floor = FloorSamples(np.concatenate(rays), np.concatenate(disparities), np.concatenate(people))
    answer = solve(replace(problem, floor=floor))
    np.testing.assert_allclose(answer.scales * problem.heights, [1.7, 1.65], rtol=0.07)
    assert answer.levels[0] - answer.levels[1] == pytest.approx(1.7, rel=0.15)
    assert abs(answer.levels[1]) < 0.1  # the grass is the ground, not the roof


def test_the_scenes_edges_overrule_how_people_lean():
    """Everybody leans by 6 degrees in the estimated poses; door frames tell the truth, and with it the child's size."""
    problem = problem_of([(1.0, -1.0, 5.0), (0.72, 1.0, 7.0)])
    axis = np.cross(tilted_up(), [0, 0, 1.0])
    lean = matrix_from_rotvec(np.radians(6) * axis / np.linalg.norm(axis)) @ tilted_up()
    leaning = replace(problem, balance=np.tile(lean, (2, 1)))
    sides = np.linalg.svd(np.eye(3) - np.outer(tilted_up(), tilted_up()))[0][:, :2].T
    told = replace(leaning, cues=UprightCues(sides, np.array([3.0, 1.0])))
    without, with_cues = solve(leaning), solve(told)
    assert degrees_between(with_cues.up, tilted_up()) < 1 < degrees_between(without.up, tilted_up())
    assert with_cues.scales[1] / with_cues.scales[0] == pytest.approx(0.72, rel=0.04)


def test_two_people_equally_far_away_do_not_flatten_the_scene():
    """The network shows one of them twice as near as the other: it is wrong about them, and the world is no wall."""
    problem = problem_of([(1.0, -1.0, 7.0), (1.0, 1.0, 7.0)])
    disparity = problem.body_depth.mean_disparity * np.array([[0.7], [1.6]])
    answer = solve(replace(problem, body_depth=replace(problem.body_depth, mean_disparity=disparity)))
    assert 1 + answer.inverse_gap / answer.inverse_far > 1.7
    np.testing.assert_allclose(answer.scales, 1.0, rtol=0.15)
