"""The paper's terms against values worked out by hand, against finite differences, and what they must ignore."""

import numpy as np
import pytest
import torch

from core_solver.energy import paper
from core_solver.energy.paper import PaperWeights

PEOPLE, FRAMES, VERTICES = 2, 4, 5


def normal(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.as_tensor(np.random.default_rng(seed).normal(size=shape))


def tensor(values) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


SEEN = tensor([[1, 0, 1, 1], [0, 1, 1, 1]])
PIXELS, CONFIDENCE = 50 * normal(PEOPLE, FRAMES, 3, 2, seed=1), tensor([0.9, 0.4, 0.51]).expand(PEOPLE, FRAMES, 3)
THETA_HAT, BETAS_HAT = normal(PEOPLE, FRAMES, 24, 3, seed=2), normal(PEOPLE, 10, seed=3)
LOG_DEPTH, FILTERED = normal(PEOPLE, FRAMES, seed=4), normal(PEOPLE, FRAMES, VERTICES, 3, seed=5)
SCENE = normal(PEOPLE, FRAMES, 3, seed=6)
ROWS = torch.tensor([[0, 1, 2, 3], [4, 0, 0, 1]])
TOUCHING = torch.tensor([[True, True, False, True], [True, True, True, True]])

# Each term as a function of what is solved for alone.
TERMS = {
    "depth, body": (lambda x: paper.depth(x, LOG_DEPTH, SEEN), normal(PEOPLE, FRAMES, seed=11)),
    "depth, scene": (lambda x: paper.depth(LOG_DEPTH, x, SEEN), normal(PEOPLE, FRAMES, seed=12)),
    "joints": (lambda x: paper.joints(x, PIXELS, CONFIDENCE, (640, 360)), PIXELS + normal(PEOPLE, FRAMES, 3, 2)),
    "silhouette": (lambda x: paper.silhouette(x, 30 * SEEN), normal(PEOPLE, FRAMES, seed=13)),
    "smpl, theta": (
        lambda x: paper.smpl(x, THETA_HAT, BETAS_HAT, BETAS_HAT, SEEN),
        THETA_HAT + normal(PEOPLE, FRAMES, 24, 3, seed=14),
    ),
    "smpl, betas": (
        lambda x: paper.smpl(THETA_HAT, THETA_HAT, x, BETAS_HAT, SEEN),
        BETAS_HAT + normal(PEOPLE, 10, seed=15),
    ),
    "scale": (lambda x: paper.scale(x, 0.1), 1 + normal(PEOPLE, seed=16)),
    "speed": (paper.speed, normal(PEOPLE, FRAMES, 3, seed=17)),
    "contact": (lambda x: paper.contact(x, SCENE), SCENE + 0.05 * normal(PEOPLE, FRAMES, 3, seed=18)),
    "slip": (lambda x: paper.slip(x, ROWS, TOUCHING), normal(PEOPLE, FRAMES, VERTICES, 3, seed=19)),
    "temporal": (lambda x: paper.temporal(x, FILTERED), FILTERED + normal(PEOPLE, FRAMES, VERTICES, 3, seed=20)),
}


def pull(energy, values: torch.Tensor) -> torch.Tensor:
    leaf = values.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(energy(leaf), leaf)
    return gradient


@pytest.mark.parametrize("name", TERMS)
def test_slopes_agree_with_differences(name):
    energy, at = TERMS[name]
    direction = normal(*at.shape, seed=30)
    step = 1e-6
    difference = (energy(at + step * direction) - energy(at - step * direction)) / (2 * step)
    slope = (pull(energy, at) * direction).sum()
    assert slope == pytest.approx(float(difference), rel=1e-5)
    assert slope != 0


# --- By hand ----------------------------------------------------------------------------------------------------------


def test_depth_is_the_squared_difference_of_mean_logs():
    body, scene = torch.log(tensor([[4.0, 5.0]])), torch.log(tensor([[2.0, 100.0]]))
    assert paper.depth(body, scene, tensor([[1, 0]])) == pytest.approx(np.log(2) ** 2)


def test_joints_are_measured_in_shares_of_the_image():
    projected = tensor([[[[64.0, 36.0], [0, 0]]]])
    energy = paper.joints(projected, torch.zeros(1, 1, 2, 2), torch.ones(1, 1, 2), (640, 360))
    assert energy == pytest.approx(0.1**2 + 0.1**2)
    # Portrait and landscape weigh their own sides.
    assert paper.joints(projected, torch.zeros(1, 1, 2, 2), torch.ones(1, 1, 2), (320, 360)) == pytest.approx(0.05)


def test_joints_ignore_the_unsure_and_trust_the_others_alike():
    away = PIXELS + 10
    gradient = pull(lambda x: paper.joints(x, PIXELS, CONFIDENCE, (640, 360)), away)
    assert (gradient[..., 1, :] == 0).all()
    assert torch.allclose(gradient[..., 0, :], gradient[..., 2, :])
    at_gate = torch.full((PEOPLE, FRAMES, 3), paper.JOINT_GATE, dtype=torch.float64)
    assert paper.joints(away, PIXELS, at_gate, (640, 360)) == 0


def test_joints_are_not_robust():
    """The paper's form: an outlier counts with its square."""
    near, far = (paper.joints(PIXELS + d, PIXELS, CONFIDENCE, (640, 360)) for d in (1, 100))
    assert far == pytest.approx(float(near) * 100**2)


def test_silhouette_is_the_mean_over_visible_pixels():
    assert paper.silhouette(tensor([[3.0, 2.0]]), tensor([[30, 4]])) == pytest.approx(0.1 + 0.5)
    assert paper.silhouette(tensor([[0.0]]), tensor([[0]])) == 0


def test_smpl_is_an_l1_norm_in_every_seen_frame():
    theta = torch.zeros(1, 2, 24, 3, dtype=torch.float64)
    theta[0, 0, 5, 1], theta[0, 0, 7, 2], theta[0, 1] = -0.5, 0.25, 9.0
    betas = torch.zeros(1, 10, dtype=torch.float64)
    betas[0, 3] = -2
    nothing = torch.zeros(1, 2, 24, 3), torch.zeros(1, 10)
    assert paper.smpl(theta, nothing[0], betas, nothing[1], tensor([[1, 0]])) == pytest.approx(0.5 + 0.25 + 2)
    assert paper.smpl(nothing[0], nothing[0], betas, nothing[1], tensor([[1, 1]])) == pytest.approx(4)


def test_scale_is_each_persons_and_the_sum_of_all():
    assert paper.scale(tensor([1.2, 0.9]), 0.0001) == pytest.approx(0.0001 * (0.04 + 0.01) + 0.1**2)
    # A giant and a dwarf leave the sum alone.
    assert paper.scale(tensor([1.5, 0.5]), 0.0001) == pytest.approx(0.0001 * 0.5)


def test_speed_is_in_metres_between_consecutive_frames():
    gamma = tensor([[[0, 0, 5], [0.3, 0, 5.4], [0.3, 0, 5.4]]])
    assert paper.speed(gamma) == pytest.approx(0.25)
    assert paper.speed(2 * gamma) == pytest.approx(1.0)


def test_speed_of_a_single_frame_is_nothing():
    assert paper.speed(normal(2, 1, 3)) == 0


def test_the_lowest_vertex_is_down_the_cameras_y_axis():
    vertices = tensor([[[[0, 1, 9], [5, 1.2, 0], [0, -3, 0]]]])
    assert paper.lowest(vertices).tolist() == [[1]]


def test_contact_is_an_l1_distance_below_20_cm_from_either_side():
    scene = torch.zeros(1, 4, 3, dtype=torch.float64)
    points = tensor([[[0.1, -0.05, 0], [0, 0.12, 0], [0, -0.21, 0], [0.1, 0.1, 0.1]]])
    assert paper.contact(points, scene) == pytest.approx(0.15 + 0.12)
    assert paper.is_touching(points, scene).tolist() == [[True, True, False, False]]
    gradient = pull(lambda x: paper.contact(x, scene), points)
    assert gradient[0].tolist() == [[1, -1, 0], [0, 1, 0], [0, 0, 0], [0, 0, 0]]


def test_slip_follows_one_vertex_and_not_the_other_foot():
    """The lowest vertex changes from one foot to the other: neither moves, so nothing slips."""
    feet = tensor([[0.0, 1.0, 5.0], [0.7, 0.98, 5.0]]).expand(1, 3, 2, 3).clone()
    feet[0, 1:, 1, 1] = 1.01
    rows = paper.lowest(feet)
    assert rows.tolist() == [[0, 1, 1]]
    all_touch = torch.ones(1, 3, dtype=torch.bool)
    assert paper.slip(feet, rows, all_touch) == 0
    feet[0, 1, 0] += tensor([0.02, 0, -0.03])
    assert paper.slip(feet, rows, all_touch) == pytest.approx(0.05)


@pytest.mark.parametrize(("touching", "counted"), [((1, 1), True), ((1, 0), False), ((0, 1), False), ((0, 0), False)])
def test_slip_counts_where_both_frames_touch(touching, counted):
    vertices = torch.zeros(1, 2, 1, 3, dtype=torch.float64)
    vertices[0, 1, 0, 0] = 0.1
    energy = paper.slip(vertices, torch.zeros(1, 2, dtype=torch.int64), torch.tensor([touching]).bool())
    assert energy == pytest.approx(0.1 * counted)


def test_slip_compares_neighbours_only():
    """Two halves of a clip that lie apart slip once, whatever their order in memory or batch."""
    vertices = torch.zeros(1, 6, 1, 3, dtype=torch.float64)
    vertices[0, 3:, 0, 2] = 1.0
    rows, touching = torch.zeros(1, 6, dtype=torch.int64), torch.ones(1, 6, dtype=torch.bool)
    assert paper.slip(vertices, rows, touching) == pytest.approx(1.0)


def test_temporal_is_a_sum_as_over_smpls_vertices():
    vertices = torch.zeros(1, 2, 3, 3, dtype=torch.float64)
    vertices[0, 1, :, 0] = 0.01  # every vertex moves by a centimetre while the filtered ones rest
    assert paper.temporal(vertices, torch.zeros_like(vertices)) == pytest.approx(6890 * 1e-4)


def test_temporal_ignores_where_people_are():
    moved = FILTERED + normal(PEOPLE, 1, VERTICES, 3, seed=21)
    assert float(paper.temporal(moved, FILTERED)) == pytest.approx(0, abs=1e-20)


@pytest.mark.parametrize("name", ["depth, body", "depth, scene", "smpl, theta"])
def test_frames_without_evidence_pull_nothing(name):
    energy, at = TERMS[name]
    gradient = pull(energy, at)

    assert (gradient[SEEN == 0] == 0).all()
    assert (gradient[SEEN == 1] != 0).any()


# --- Weights ----------------------------------------------------------------------------------------------------------


def test_the_lambdas_are_the_papers():
    w = PaperWeights()
    assert (w.joints, w.silhouette, w.depth, w.speed) == (1, 0.1, 0.05, 0.05)
    assert (w.smpl, w.temporal, w.scale_each, w.contact, w.slip) == (0.002, 0.002, 0.0001, 0.001, 0.01)


def test_every_term_has_a_switch():
    assert set(PaperWeights.terms()) == {
        "joints", "silhouette", "depth", "smpl", "scale", "speed", "contact", "slip", "temporal",
    }  # fmt: skip
