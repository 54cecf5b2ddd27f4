import numpy as np
import pytest
import torch

from core_solver.body import kinematics
from core_solver.optimise.posing import pose, sole_rows, torch_body


@pytest.fixture(scope="module")
def solver_body(body):
    return torch_body(body, torch.device("cpu"), torch.float64)


def test_skin_is_the_numpy_skin_of_every_person_and_frame(body, solver_body):
    rng = np.random.default_rng(0)
    theta, betas = rng.normal(size=(2, 3, 24, 3)), rng.normal(size=(2, 10))
    posed = pose(torch.as_tensor(theta), torch.as_tensor(betas), solver_body)
    keypoints = posed.skin(solver_body.keypoints, torch.as_tensor(betas)).numpy()
    proxy = posed.skin(solver_body.proxy, torch.as_tensor(betas)).numpy()
    assert proxy.shape == (2, 3, len(body.proxy), 3)
    for n in range(2):
        rest = body.rest_joints(betas[n])
        rotations, positions = kinematics.pose_joints(theta[n], rest)
        np.testing.assert_allclose(posed.positions[n].numpy(), positions, atol=1e-9)
        expected = kinematics.skin(body.rest_keypoints(betas[n]), body.keypoint_weights, rotations, positions, rest)
        np.testing.assert_allclose(keypoints[n], expected, atol=1e-9)
        vertices = kinematics.skin(body.rest_vertices(betas[n]), body.weights, rotations, positions, rest)
        np.testing.assert_allclose(proxy[n], vertices[:, body.proxy], atol=1e-9)


def test_skin_has_true_gradients(solver_body):
    rng = np.random.default_rng(1)
    theta = torch.as_tensor(rng.normal(size=(1, 1, 24, 3))).requires_grad_()
    betas = torch.as_tensor(rng.normal(size=(1, 10))).requires_grad_()

    def ankles(theta, betas):
        return pose(theta, betas, solver_body).skin(solver_body.keypoints, betas)[:, :, 15:17]

    assert torch.autograd.gradcheck(ankles, (theta, betas), rtol=1e-3)


def test_the_rest_pose_has_finite_gradients(solver_body):
    theta = torch.zeros(1, 2, 24, 3, dtype=torch.float64, requires_grad=True)
    betas = torch.zeros(1, 10, dtype=torch.float64)
    pose(theta, betas, solver_body).skin(solver_body.proxy, betas).square().sum().backward()
    assert theta.grad is not None
    assert torch.isfinite(theta.grad).all()


def test_soles_lie_under_the_feet_of_each_side(body):
    rest = body.rest_vertices(body.neutral_betas)[body.proxy]
    left, right = sole_rows(body)
    assert len(left) == len(right) > 3
    assert len(set(left) | set(right)) == len(left) + len(right)
    assert (rest[left, 0] > 0).all()
    assert (rest[right, 0] < 0).all()
    low = rest[:, 1].min()
    assert (rest[np.concatenate([left, right]), 1] < low + 0.03).all()
    # From heel to toe, so that a foot on its toes still touches the ground.
    for rows in (left, right):
        assert np.ptp(rest[rows, 2]) > 0.15


def test_followed_points_are_the_keypoints_and_then_the_joints(solver_body):
    rng = np.random.default_rng(2)
    theta, betas = torch.as_tensor(rng.normal(size=(2, 3, 24, 3))), torch.as_tensor(rng.normal(size=(2, 10)))
    posed = pose(theta, betas, solver_body)
    followed = posed.skin(solver_body.followed, betas)
    torch.testing.assert_close(followed[:, :, :25], posed.skin(solver_body.keypoints, betas))
    torch.testing.assert_close(followed[:, :, 25:], posed.positions)
