"""The energy of a clip about its truth: what it must see, and what it must be blind to."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from core_solver.energy.weights import Weights
from core_solver.optimise.second_order import Schedule, minimise
from core_solver.optimise.variables import Variables, pose_person, pose_points
from tests.solver.optimise.problems import CLOSELY, SWITCHES, Problem, disturbed, disturbed_alike, only, total
from tests.solver.scenes import Walker, make_clip

FRAMES = 6
LOOKED = ("contact", "penetration", "slip", "temporal", "depth", "silhouette", "collision")


@pytest.fixture(scope="module")
def clip(body):
    return make_clip(body, [Walker(1.0, (-1, 5), 0.5), Walker(0.9, (1, 6), -1.0)], frames=FRAMES, noise_px=0)


@pytest.fixture(scope="module")
def problem(clip, body):
    made = Problem(clip, body)
    made.look()
    return made


def terms_of(problem: Problem, v: Variables) -> dict[str, float]:
    """Each term's sum over people."""
    energy, sums = problem.energy, {}
    with torch.no_grad():
        for n in range(energy.people):
            for name, value in energy.person_terms(v, n, pose_person(v, n, energy.body)).items():
                sums[name] = sums.get(name, 0.0) + float(value)
    return sums


def scale_pull(problem: Problem, v: Variables) -> np.ndarray:
    """(N,) derivative of the whole energy by log scale."""
    leaves = v.leaves()
    total(problem.energy, leaves).backward()
    return np.zeros(problem.energy.people) if leaves.log_scale.grad is None else leaves.log_scale.grad.numpy()


# --- The start, the ground, the picture ---------------------------------------------------------------------------


def test_points_at_the_start_are_the_true_people(problem, body):
    points = pose_points(problem.variables, problem.solver_body)
    np.testing.assert_allclose(points.proxy, problem.clip.vertices[:, :, body.proxy], atol=1e-9)
    np.testing.assert_allclose(points.joints, problem.clip.joints, atol=1e-9)


def test_projection_is_the_cameras(problem):
    points = pose_points(problem.variables, problem.solver_body).joints
    found = problem.energy.project(problem.variables, points)
    np.testing.assert_allclose(found, problem.clip.camera.project(points.numpy(), distorted=False), atol=1e-9)


def test_heights_are_measured_above_the_true_ground(problem):
    for n in range(2):
        posed = pose_person(problem.variables, n, problem.solver_body)
        heights = problem.energy.sole_heights(problem.variables, n, posed).numpy()
        assert heights.shape[:3] == (1, FRAMES, 2)
        assert heights.min() == pytest.approx(0, abs=0.02)
        assert (heights.min(axis=(0, 2, 3)) < 0.06).all()


def test_a_tilt_raises_what_lies_to_its_side(problem):
    """The ground's unknowns against a plane worked out by hand."""
    v = problem.changed(ground=torch.tensor([0.02, -0.01, 0.05], dtype=torch.float64))
    up, first, second = problem.energy.given.up.numpy()
    normal = up + 0.02 * first - 0.01 * second
    normal /= np.linalg.norm(normal)
    np.testing.assert_allclose(problem.energy.up(v), normal, atol=1e-12)
    soles = problem.solver_body.soles
    rows = [int(np.argmin(np.abs(problem.body.template - place).sum(1))) for place in soles.template.numpy()]
    truth = problem.clip.vertices[0][:, rows] @ normal + 2.2 * math.exp(0.05)
    found = problem.energy.sole_heights(v, 0, pose_person(v, 0, problem.solver_body))[0].flatten(1)
    np.testing.assert_allclose(found, truth, atol=1e-9)


def test_statures_are_those_of_the_scaled_body(problem, body):
    betas = torch.zeros(2, 10, dtype=torch.float64)
    betas[0, 0], betas[1, 4] = 1.5, -1.0
    heights = torch.exp(problem.energy.log_heights(problem.changed(betas=betas)))
    truth = [scale * body.height(b) for scale, b in zip(problem.clip.scales, betas.numpy(), strict=True)]
    np.testing.assert_allclose(heights, truth, rtol=1e-9)


def test_levels_and_steps_are_taken_from_a_persons_own_support(clip, body):
    problem = Problem(clip, body, levels=[0.0, 0.3])
    problem.look()
    flat = terms_of(Problem(clip, body), problem.variables)
    assert "contact" not in flat  # nothing has been looked at
    assert problem.energy.motion.support is not None
    np.testing.assert_allclose(problem.energy.motion.support[0], 0, atol=1e-12)
    np.testing.assert_allclose(problem.energy.motion.support[1], 0.3, atol=1e-12)


# --- Scale ----------------------------------------------------------------------------------------------------------


def test_scale_moves_people_along_their_rays_and_leaves_the_picture(problem):
    """The valley of scale against depth is no valley in these variables."""
    taller = problem.changed(log_scale=problem.variables.log_scale + 0.1)
    points, old = (pose_points(v, problem.solver_body).keypoints for v in (taller, problem.variables))
    np.testing.assert_allclose(points, math.exp(0.1) * old, atol=1e-12)
    np.testing.assert_allclose(points[..., :2] / points[..., 2:], old[..., :2] / old[..., 2:], atol=1e-12)
    before, after = terms_of(problem, problem.variables), terms_of(problem, taller)
    for name in set(before) - {"height", "guard", "depth", "contact", "penetration", "collision"}:
        assert after[name] == pytest.approx(before[name], abs=1e-9), name


def test_of_all_terms_of_one_frame_only_the_prior_objects_to_another_scale(clip, body):
    problem = Problem(clip, body, only(*SWITCHES))
    taller = problem.changed(log_scale=problem.variables.log_scale + 0.1)
    mixture = np.array(problem.weights.statures())

    def cost(log_heights: np.ndarray) -> float:
        share, mean, sigma = mixture.T
        density = share / sigma * np.exp(-0.5 * ((log_heights[:, None] - mean) / sigma) ** 2)
        return float(-2 * np.log(density.sum(axis=1)).sum())

    heights = np.log(1.70 * clip.scales)
    collided = terms_of(problem, taller)["collision"] - terms_of(problem, problem.variables)["collision"]
    change = problem.energy.value(taller) - problem.energy.value(problem.variables) - collided
    assert change == pytest.approx(cost(heights + 0.1) - cost(heights), rel=1e-6)


@pytest.mark.parametrize("name", ["height"])
def test_the_scale_terms_do_not_depend_on_the_number_of_frames(body, name):
    """A prior that holds once for each person must count once, whatever the clip's length."""

    def pull(frames: int) -> float:
        clip = make_clip(body, [Walker(1.2, (0, 5), 0.5, is_still=True)], frames=frames, noise_px=0)
        problem = Problem(clip, body, only(name))
        return float(scale_pull(problem, problem.variables)[0])

    assert pull(3) > 1
    assert pull(12) == pytest.approx(pull(3), rel=1e-9)


@pytest.mark.parametrize("each_pixel", [True, False])
def test_depth_counts_as_a_few_measurements_whatever_the_length(body, each_pixel):
    def pull(frames: int) -> float:
        clip = make_clip(body, [Walker(1.0, (0, 5), 0.5, is_still=True)], frames=frames, noise_px=0)
        problem = Problem(clip, body, only("depth"))
        problem.look(closely=type(CLOSELY)(160, 32, each_pixel))
        wrong = problem.changed(log_scale=problem.variables.log_scale + 0.2)
        return float(scale_pull(problem, wrong)[0])

    assert pull(8) > 0
    assert pull(24) == pytest.approx(pull(8), rel=0.02)


def test_few_frames_are_not_blown_up_to_a_few_measurements(body):
    clip = make_clip(body, [Walker(1.0, (0, 5), 0.5, is_still=True)], frames=2, noise_px=0)
    assert (Problem(clip, body).energy.given.per_clip == 1).all()


@pytest.mark.parametrize("each_pixel", [True, False])
def test_true_depth_has_no_bias(clip, body, each_pixel):
    """The body's own surface, seen in the true depth map, wants neither a nearer nor a farther body."""
    problem = Problem(clip, body, only("depth"))
    problem.look(closely=type(CLOSELY)(160, 32, each_pixel))

    def cost(offset: float) -> float:
        return problem.energy.value(problem.changed(log_scale=problem.variables.log_scale + offset))

    offsets = np.linspace(-0.1, 0.1, 41)
    assert offsets[np.argmin([cost(offset) for offset in offsets])] == pytest.approx(0, abs=0.03)


def test_frames_in_chorus_do_not_talk_the_sizes_away(body):
    """The more frames there are, the more it takes: their errors persist, and so must what lasting facts said."""
    costs = []
    for frames in (2, 8):
        clip = make_clip(body, [Walker(1.0, (0, 5), 0.5)], frames=frames, noise_px=0)
        problem = Problem(clip, body, only(guard_sigma=0.01))
        grown = problem.changed(log_scale=problem.variables.log_scale + 0.02)
        lower = problem.changed(ground=torch.tensor([0, 0, -0.02], dtype=torch.float64))
        costs.append([problem.energy.value(v) for v in (problem.variables, grown, lower)])
    np.testing.assert_allclose(costs[0], [0, 2 * 4, 2 * 4], atol=1e-9)
    np.testing.assert_allclose(costs[1], [0, 8 * 4, 8 * 4], atol=1e-9)


MOTION = ("speed", "acceleration", "slip", "temporal")


@pytest.mark.parametrize("name", MOTION)
def test_motion_terms_do_not_shrink_the_scene(clip, body, name):
    """Calm must not be bought by smaller people: motion is measured at unit scale."""
    problem = Problem(clip, body, only(name))
    problem.look()
    problem.energy.look(filtered=torch.zeros(2, FRAMES, 49, 3, dtype=torch.float64))
    moved = disturbed(problem.variables, 0.05, 0.1)
    assert problem.energy.value(moved) > 1e-6
    np.testing.assert_allclose(scale_pull(problem, moved), 0, atol=1e-9)


@pytest.mark.parametrize("name", ["contact", "penetration"])
def test_contact_neither_shrinks_nor_grows_the_scene(clip, body, name):
    """In metres a small world has small heights: contact once was bought by shrinking everything.

    A scene in another size, ground and all, must cost the same to the last digit.
    """
    problem = Problem(clip, body, only(name))
    problem.look()
    # A foot a little into the ground and another a little above it.
    shift = torch.tensor([0.03, -0.03], dtype=torch.float64)[:, None, None] * torch.as_tensor(clip.up)
    moved = problem.changed(translation=problem.variables.translation + shift)

    def cost(factor: float) -> float:
        growth = math.log(factor)
        ground = moved.ground + torch.tensor([0, 0, growth], dtype=torch.float64)
        resized = Variables(**{**vars(moved), "log_scale": moved.log_scale + growth, "ground": ground})
        motion = problem.energy.motion
        assert motion.support is not None
        sized = problem.energy_with(problem.weights)
        sized.look(contacts=motion.contacts, support=factor * motion.support)
        return sum(float(sized.person(resized, n)) for n in range(2))

    assert cost(1.0) > 1e-3
    for factor in (0.5, 0.9, 1.1, 2.0):
        assert cost(factor) == pytest.approx(cost(1.0), rel=1e-9)


def test_collision_does_not_shrink_the_scene(clip, body):
    """Two who overlap are moved apart; they are not made thinner: radii keep their size while scale is judged."""
    problem = Problem(clip, body, only("collision"))
    problem.look()
    centre = problem.variables.translation.mean(0, keepdim=True).expand(2, -1, -1)
    close = problem.changed(translation=centre + torch.tensor([[[0.1, 0, 0]], [[-0.1, 0, 0]]]).double(),
                            log_scale=problem.variables.log_scale * 0)  # fmt: skip
    problem.look(close)
    assert problem.energy.value(close) > 1
    # What is left of a pull on scale only pushes people apart along their rays: not both of them towards smaller.
    pull = scale_pull(problem, close)
    assert not (pull > 0.05 * problem.energy.value(close)).all()


# --- Switches, orders, lengths ----------------------------------------------------------------------------------------


def test_near_is_always_nearer_than_far(problem):
    wild = torch.randn(FRAMES, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * 5
    v = problem.changed(log_inverse_far=wild, log_inverse_gap=-wild)
    far, gap = torch.exp(v.log_inverse_far), torch.exp(v.log_inverse_gap)
    z_near, z_far = 1 / (far + gap), 1 / far
    assert ((z_near > 0) & (z_near < z_far)).all()


def strained(problem: Problem) -> Variables:
    """Every term has something to object to here."""
    worse = disturbed(problem.variables, 0.15, 0.05)
    sunk = torch.tensor([0.08, -0.02], dtype=torch.float64)[:, None, None] * -torch.as_tensor(problem.clip.up)
    return Variables(
        **{
            **vars(worse),
            "translation": worse.translation + sunk,
            "betas": worse.betas + 0.5,
            "log_scale": worse.log_scale + 0.05,
        }
    )


@pytest.fixture(scope="module")
def strained_values(clip, body):
    """What each term costs where all of them are on and everything is wrong."""
    problem = Problem(clip, body)
    problem.look()
    v = strained(problem)
    return problem, v, terms_of(problem, v)


@pytest.mark.parametrize("name", SWITCHES)
def test_a_weight_of_zero_switches_a_term_off(strained_values, clip, body, name):
    problem, v, values = strained_values
    if name == "collision":
        # Arms through the trunk.
        v = problem.changed(theta=v.theta + torch.randn(v.theta.shape, generator=torch.Generator().manual_seed(3)))
        values = terms_of(problem, v)
    assert values[name] > 1e-6
    alone = problem.energy_with(only(name))
    alone.motion = problem.energy.motion
    without = problem.energy_with(Weights(**{name: 0.0}))
    without.motion = problem.energy.motion
    energies = [sum(float(e.person(v, n)) for n in range(2)) for e in (alone, without, problem.energy)]
    assert energies[0] == pytest.approx(values[name], rel=1e-9)
    assert energies[0] + energies[1] == pytest.approx(energies[2], rel=1e-9)


def test_all_terms_off_cost_nothing(strained_values):
    problem, v, _ = strained_values
    silent = problem.energy_with(only())
    silent.motion = problem.energy.motion
    assert sum(float(silent.person(v, n)) for n in range(2)) == 0


def test_a_weight_counts_in_proportion(strained_values):
    problem, v, values = strained_values
    doubled = problem.energy_with(Weights(**{name: 2 * getattr(Weights(), name) for name in SWITCHES}))
    doubled.motion = problem.energy.motion
    expected = 2 * sum(value for name, value in values.items() if name in SWITCHES) + values["guard"]
    assert sum(float(doubled.person(v, n)) for n in range(2)) == pytest.approx(expected, rel=1e-9)


def test_the_whole_is_people_and_scene(problem):
    v = disturbed(problem.variables)
    assert problem.energy.value(v) == pytest.approx(float(total(problem.energy, v)), rel=1e-12)


def test_people_meet_only_in_collision(problem):
    """One person's energy does not change with another's pose: that is what makes the systems separate."""
    v = problem.variables
    theta = v.theta.clone()
    theta[1] += 0.1
    before = float(problem.energy.person(v, 0))
    assert float(problem.energy.person(problem.changed(theta=theta), 0)) == before


def test_a_frame_without_evidence_has_no_data_terms(clip, body):
    from dataclasses import replace

    from tests.solver.scenes import SyntheticClip, change_tracks

    def hide(track):
        valid = track.valid.copy()
        valid[2] = False
        return replace(track, valid=valid, confidence=track.confidence * valid[:, None])

    labels = clip.modalities.labels.copy()
    labels[2] = 0
    hidden = SyntheticClip(**{**vars(clip), "modalities": replace(change_tracks(clip, hide), labels=labels)})
    problem = Problem(hidden, body, only("joints", "depth", "silhouette", "contact", "penetration", "slip"))
    problem.look()
    leaves = disturbed(problem.variables).leaves()
    total(problem.energy, leaves).backward()
    assert leaves.theta.grad is not None
    assert (leaves.theta.grad[:, 2] == 0).all()
    assert (leaves.theta.grad[:, [0, 1, 3]].abs().amax(dim=(2, 3)) > 0).all()


@pytest.mark.parametrize("frames", [1, 2])
def test_one_and_two_frames_have_every_term_they_can(body, frames):
    problem = Problem(make_clip(body, [Walker(1.0, (0, 5), 0.5)], frames=frames), body)
    problem.look()
    found = terms_of(problem, problem.variables)
    missing = {1: {"speed", "acceleration", "temporal"}, 2: {"acceleration"}}[frames]
    assert set(found) == set(SWITCHES) - missing | {"guard"}
    leaves = disturbed(problem.variables).leaves()
    value = total(problem.energy, leaves)
    value.backward()
    assert math.isfinite(value.item())
    for name in ("theta", "translation", "betas", "log_scale", "ground"):
        gradient = getattr(leaves, name).grad
        assert gradient is not None, name
        assert torch.isfinite(gradient).all(), name


def test_every_gradient_is_that_of_the_value(strained_values):
    """Directional differences in every unknown; only collision hides something from its gradient, the scale."""
    strained_problem, v, _ = strained_values
    problem = SimpleNamespace(energy=strained_problem.energy_with(Weights(collision=0.0)))
    problem.energy.motion = strained_problem.energy.motion
    names = ("theta", "translation", "betas", "log_scale", "ground", "log_inverse_far", "log_inverse_gap", "log_range")
    leaves = v.leaves()
    total(problem.energy, leaves).backward()
    rng = np.random.default_rng(4)
    for name in names:
        start = getattr(v, name)
        direction = torch.as_tensor(rng.normal(size=start.shape))
        gradient = getattr(leaves, name).grad

        def at(step: float, name=name, start=start, direction=direction) -> float:
            return problem.energy.value(Variables(**{**vars(v), name: start + step * direction}))

        slope = (at(1e-6) - at(-1e-6)) / 2e-6
        assert float((gradient * direction).sum()) == pytest.approx(slope, rel=2e-4, abs=1e-4), name


def test_the_focal_length_is_free_only_where_it_is_unknown(clip, body):
    for sigma, free in ((0.0, False), (0.1, True)):
        problem = Problem(clip, body, Weights(focal_sigma=sigma))
        longer = problem.changed(log_focal=torch.tensor(0.05, dtype=torch.float64))
        change = problem.energy.value(longer) - problem.energy.value(problem.variables)
        assert (change > 0.2) == free


def test_a_disturbed_start_comes_back_to_the_truth(problem):
    start = disturbed_alike(problem.variables)
    truth = problem.clip.joints / problem.clip.scales[:, None, None, None]

    def error(v: Variables) -> float:
        joints = pose_points(v, problem.solver_body).joints.numpy()
        return float(np.linalg.norm(joints / np.exp(v.log_scale.numpy())[:, None, None, None] - truth, axis=-1).mean())

    found = minimise(problem.energy, start, Schedule(12, 1e-4))
    # Feet of this clip do not quite rest: the energy's lowest place is near the truth, not at it.
    assert problem.energy.value(found) < problem.energy.value(problem.variables) < 0.25 * problem.energy.value(start)
    assert error(found) < 0.25 * error(start)
