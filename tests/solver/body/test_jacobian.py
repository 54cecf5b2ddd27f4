"""The closed form against automatic differentiation of the skinning itself."""

import math

import numpy as np
import pytest
import torch

from core_solver.body.jacobian_torch import levers, point_jacobian, shape_jacobian
from core_solver.body.kinematics_torch import pose_joints, skin
from tests.solver.body.synthetic import make_stick_body

FRAMES, POINTS = 2, 7


@pytest.fixture(scope="module")
def body():
    return make_stick_body()


class Skin:
    """Skinned points of a clip as a function of theta and betas; `each` gives every frame its own points."""

    def __init__(self, body, each: bool) -> None:
        rng = np.random.default_rng(0)
        shape = (FRAMES, POINTS) if each else (POINTS,)
        # Rows of no real body: every joint carries a share of every point, so that no entry of the answer is zero.
        share = rng.uniform(size=(*shape, 24))
        self.weights = torch.as_tensor(share / share.sum(-1, keepdims=True))
        self.template = torch.as_tensor(rng.normal(size=(*shape, 3)))
        self.directions = torch.as_tensor(0.1 * rng.normal(size=(*shape, 3, 10)))
        self.joint_template = torch.as_tensor(body.joint_template)
        self.joint_directions = torch.as_tensor(body.joint_directions)

    def joints(self, betas):
        return self.joint_template + self.joint_directions @ betas

    def rest(self, betas):
        return self.template + self.directions @ betas

    def __call__(self, theta, betas):
        rotations, positions = pose_joints(theta, self.joints(betas))
        rest, weights = self.rest(betas), self.weights
        return torch.stack(
            [
                skin(rest[t] if rest.dim() == 3 else rest, weights[t] if weights.dim() == 3 else weights,
                     rotations[t], positions[t], self.joints(betas))
                for t in range(len(theta))
            ]
        )  # fmt: skip

    def levers(self, theta, betas):
        joints = self.joints(betas)
        return levers(theta, *pose_joints(theta, joints), joints, self.joint_directions)


def turns(kind: str) -> torch.Tensor:
    """(T, 24, 3) radians of every size that clips contain, and where formulas change or have poles."""
    rng = np.random.default_rng(1)
    axes = rng.normal(size=(FRAMES, 24, 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    angles = {
        "none": 0.0, "tiny": 1e-5, "series ends": 0.3, "lively": rng.uniform(0.1, 2, (FRAMES, 24, 1)),
        "nearly half": math.pi - 1e-4, "half": math.pi, "more than half": 4.0, "nearly whole": 2 * math.pi - 0.01,
    }[kind]  # fmt: skip
    return torch.as_tensor(axes * angles)


KINDS = ("none", "tiny", "series ends", "lively", "nearly half", "half", "more than half", "nearly whole")


@pytest.mark.parametrize("each", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_points_move_with_angles_as_differentiation_says(body, kind, each):
    posed, theta, betas = Skin(body, each), turns(kind), torch.linspace(-1, 1, 10, dtype=torch.float64)
    truth = torch.autograd.functional.jacobian(lambda x: posed(x, betas), theta)
    found = point_jacobian(posed.levers(theta, betas), posed.rest(betas), posed.weights)
    assert found.shape == (FRAMES, POINTS, 3, 72)
    for frame in range(FRAMES):
        np.testing.assert_allclose(found[frame], truth[frame, :, :, frame].flatten(2), atol=2e-6)
        # Other frames' angles move nothing.
        assert (truth[frame, :, :, 1 - frame] == 0).all()


@pytest.mark.parametrize("each", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_points_move_with_shape_as_differentiation_says(body, kind, each):
    posed, theta, betas = Skin(body, each), turns(kind), torch.linspace(-1, 1, 10, dtype=torch.float64)
    truth = torch.autograd.functional.jacobian(lambda x: posed(theta, x), betas)
    found = shape_jacobian(posed.levers(theta, betas), posed.directions, posed.weights)
    assert found.shape == (FRAMES, POINTS, 3, 10)
    np.testing.assert_allclose(found, truth, atol=1e-9)


def test_single_precision_keeps_its_digits_near_zero(body):
    """(x - sin x) / x^3 as it stands would lose all of them."""
    posed, betas = Skin(body, each=False), torch.zeros(10, dtype=torch.float64)
    exact = point_jacobian(posed.levers(turns("tiny"), betas), posed.rest(betas), posed.weights)
    joints = posed.joints(betas).float()
    theta = turns("tiny").float()
    lever = levers(theta, *pose_joints(theta, joints), joints, posed.joint_directions.float())
    rounded = point_jacobian(lever, posed.rest(betas).float(), posed.weights.float())
    np.testing.assert_allclose(rounded, exact, atol=2e-5)


def test_the_root_turns_everything_about_itself(body):
    """By hand: a point a metre to the left of the pelvis goes backwards as the body turns left about y."""
    joints = torch.as_tensor(body.joint_template)
    theta = torch.zeros(1, 24, 3, dtype=torch.float64)
    lever = levers(theta, *pose_joints(theta, joints), joints, torch.as_tensor(body.joint_directions))
    weights = torch.eye(24, dtype=torch.float64)[:1]
    found = point_jacobian(lever, joints[:1] + torch.tensor([[1.0, 0, 0]], dtype=torch.float64), weights)
    np.testing.assert_allclose(found[0, 0, :, 1], [0, 0, -1], atol=1e-12)
    assert (found[0, 0, :, 3:] == 0).all()
