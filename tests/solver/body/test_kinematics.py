"""numpy and torch kinematics against an independent chain of 4x4 matrices, finite differences and rigid motions."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from core_solver.body import PARENTS, kinematics, kinematics_torch
from tests.solver.body.synthetic import make_stick_body

BODY = make_stick_body()


def random_pose(seed: int, *batch: int, spread: float = 0.7) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, spread, (*batch, 24, 3))


def random_betas(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 1, 10)


def chain_of_matrices(theta: np.ndarray, rest_joints: np.ndarray) -> np.ndarray:
    """(24, 4, 4) posed-from-joint-local transforms, written the textbook way."""
    chain = []
    for joint, parent in enumerate(PARENTS):
        local = np.eye(4)
        local[:3, :3] = Rotation.from_rotvec(theta[joint]).as_matrix()
        local[:3, 3] = rest_joints[joint] - (rest_joints[parent] if parent >= 0 else 0)
        chain.append(local if parent < 0 else chain[parent] @ local)
    return np.stack(chain)


def skin_by_matrices(points: np.ndarray, weights: np.ndarray, chain: np.ndarray, rest_joints: np.ndarray) -> np.ndarray:
    to_local = np.tile(np.eye(4), (24, 1, 1))
    to_local[:, :3, 3] = -rest_joints
    blended = np.einsum("pj,jab->pab", weights, chain @ to_local)
    return np.einsum("pab,pb->pa", blended, np.c_[points, np.ones(len(points))])[:, :3]


def posed_vertices(theta: np.ndarray, betas: np.ndarray) -> np.ndarray:
    rest = BODY.rest_joints(betas)
    return kinematics.skin(BODY.rest_vertices(betas), BODY.weights, *kinematics.pose_joints(theta, rest), rest)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_joints_and_skin_equal_a_chain_of_4x4_matrices(seed):
    theta, betas = random_pose(seed), random_betas(seed)
    rest = BODY.rest_joints(betas)
    chain = chain_of_matrices(theta, rest)
    rotations, positions = kinematics.pose_joints(theta, rest)
    np.testing.assert_allclose(positions, chain[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(rotations, chain[:, :3, :3], atol=1e-12)
    expected = skin_by_matrices(BODY.rest_vertices(betas), BODY.weights, chain, rest)
    np.testing.assert_allclose(posed_vertices(theta, betas), expected, atol=1e-12)


@pytest.mark.parametrize("batch", [(), (5,), (2, 3)])
def test_torch_equals_numpy_on_any_batch(batch):
    theta, rest = random_pose(1, *batch), BODY.rest_joints(random_betas(1))
    points = BODY.rest_vertices(random_betas(1))
    rotations, positions = kinematics.pose_joints(theta, rest)
    expected = kinematics.skin(points, BODY.weights, rotations, positions, rest)
    tensors = [torch.tensor(a) for a in (theta, rest, points, BODY.weights)]
    t_theta, t_rest, t_points, t_weights = tensors
    t_rotations, t_positions = kinematics_torch.pose_joints(t_theta, t_rest)
    t_skinned = kinematics_torch.skin(t_points, t_weights, t_rotations, t_positions, t_rest)
    np.testing.assert_allclose(t_rotations.numpy(), rotations, atol=1e-7)
    np.testing.assert_allclose(t_positions.numpy(), positions, atol=1e-7)
    np.testing.assert_allclose(t_skinned.numpy(), expected, atol=1e-7)
    assert t_skinned.shape == (*batch, len(points), 3)


def test_people_of_different_shape_are_posed_in_one_batch():
    betas = np.stack([random_betas(1), random_betas(2)])
    theta = random_pose(3, 2, 4)
    rest, points = BODY.rest_joints(betas)[:, None], BODY.rest_vertices(betas)[:, None]
    together = kinematics.skin(points, BODY.weights, *kinematics.pose_joints(theta, rest), rest)
    tensors = [torch.tensor(a) for a in (theta, rest, points, BODY.weights)]
    posed = kinematics_torch.pose_joints(tensors[0], tensors[1])
    together_torch = kinematics_torch.skin(tensors[2], tensors[3], *posed, tensors[1])
    for person in range(2):
        alone = posed_vertices(theta[person], betas[person])
        np.testing.assert_allclose(together[person], alone, atol=1e-12)
        np.testing.assert_allclose(together_torch[person].numpy(), alone, atol=1e-7)


def test_zero_pose_is_the_rest_mesh():
    betas = random_betas(4)
    np.testing.assert_allclose(posed_vertices(np.zeros((24, 3)), betas), BODY.rest_vertices(betas), atol=1e-12)


def test_root_rotation_moves_the_whole_posed_body_rigidly_about_the_rest_pelvis():
    theta, betas = random_pose(5), random_betas(5)
    turned = theta.copy()
    extra = Rotation.from_rotvec([0.4, -1.1, 0.8])
    turned[0] = (extra * Rotation.from_rotvec(theta[0])).as_rotvec()
    pelvis = BODY.rest_joints(betas)[0]
    assert np.linalg.norm(pelvis) > 0.1
    expected = extra.apply(posed_vertices(theta, betas) - pelvis) + pelvis
    np.testing.assert_allclose(posed_vertices(turned, betas), expected, atol=1e-12)


def test_bones_keep_their_length():
    rest = BODY.rest_joints(random_betas(6))
    _, positions = kinematics.pose_joints(random_pose(6, 50), rest)
    parents = list(PARENTS[1:])
    lengths = np.linalg.norm(positions[:, 1:] - positions[:, parents], axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(np.linalg.norm(rest[1:] - rest[parents], axis=-1), (50, 23)))


def test_a_bent_elbow_moves_only_the_forearm():
    theta = np.zeros((24, 3))
    theta[18] = [0, -np.pi / 2, 0]
    _, positions = kinematics.pose_joints(theta, BODY.joint_template)
    moved = np.linalg.norm(positions - BODY.joint_template, axis=-1) > 1e-9
    assert set(np.flatnonzero(moved)) == {20, 22}
    forearm = positions[20] - positions[18]
    # A quarter turn about -y brings the left forearm from the body's left (+x) to its front (+z).
    assert forearm[2] > 0.9 * np.linalg.norm(forearm)


def test_pose_blend_is_zero_at_rest_and_equal_in_both_libraries():
    directions = np.random.default_rng(7).normal(size=(11, 3, 207))
    theta = random_pose(7, 2, 3)
    offsets = kinematics.pose_blend(theta, directions)
    assert offsets.shape == (2, 3, 11, 3)
    feature = (Rotation.from_rotvec(theta[1, 2, 1:]).as_matrix() - np.eye(3)).reshape(207)
    np.testing.assert_allclose(offsets[1, 2], directions @ feature, atol=1e-9)
    twin = kinematics_torch.pose_blend(torch.tensor(theta), torch.tensor(directions)).numpy()
    np.testing.assert_allclose(twin, offsets, atol=1e-6)
    np.testing.assert_allclose(kinematics.pose_blend(np.zeros((24, 3)), directions), 0, atol=1e-15)


@pytest.mark.parametrize("seed", [0, 1])
def test_gradients_equal_finite_differences(seed):
    chosen = BODY.proxy[::40]
    weights = torch.tensor(BODY.weights[chosen])
    template, directions = torch.tensor(BODY.template[chosen]), torch.tensor(BODY.shape_directions[chosen])
    rest_template, rest_directions = torch.tensor(BODY.joint_template), torch.tensor(BODY.joint_directions)

    def forward(theta, betas):
        rest = rest_template + rest_directions @ betas
        posed = kinematics_torch.pose_joints(theta, rest)
        return kinematics_torch.skin(template + directions @ betas, weights, *posed, rest), posed[1]

    theta = torch.tensor(random_pose(seed, 2), requires_grad=True)
    betas = torch.tensor(random_betas(seed), requires_grad=True)
    assert torch.autograd.gradcheck(forward, (theta, betas), atol=1e-7)


def test_gradient_is_finite_at_the_rest_pose():
    theta = torch.zeros(24, 3, requires_grad=True)
    _, positions = kinematics_torch.pose_joints(theta, torch.tensor(BODY.joint_template, dtype=torch.float32))
    positions.square().sum().backward()
    assert theta.grad is not None
    assert torch.isfinite(theta.grad).all()
    assert theta.grad.abs().max() > 0


def test_pose_and_shape_are_found_again_from_posed_points():
    rest_template, rest_directions = torch.tensor(BODY.joint_template), torch.tensor(BODY.joint_directions)
    points, weights = torch.tensor(BODY.template[BODY.proxy]), torch.tensor(BODY.weights[BODY.proxy])
    directions = torch.tensor(BODY.shape_directions[BODY.proxy])

    def forward(x: torch.Tensor) -> torch.Tensor:
        theta, betas = x[:72].reshape(24, 3), x[72:]
        rest = rest_template + rest_directions @ betas
        posed = kinematics_torch.pose_joints(theta, rest)
        return kinematics_torch.skin(points + directions @ betas, weights, *posed, rest)

    hidden = np.concatenate([random_pose(8, spread=0.3).ravel(), random_betas(8)])
    truth = forward(torch.tensor(hidden))

    def residuals(x: np.ndarray) -> np.ndarray:
        return (forward(torch.tensor(x)) - truth).numpy().ravel()

    def jacobian(x: np.ndarray) -> np.ndarray:
        return torch.func.jacfwd(forward)(torch.tensor(x)).reshape(-1, 82).numpy()

    found = least_squares(residuals, np.full(82, 0.01), jac=jacobian)  # pyright: ignore[reportArgumentType]
    np.testing.assert_allclose(found.x, hidden, atol=1e-6)
