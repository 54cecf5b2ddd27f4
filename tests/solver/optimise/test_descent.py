import math

import pytest
import torch

from core_solver.optimise.descent import descend


def test_a_bowl_is_descended_to_its_bottom():
    goal = torch.tensor([1.0, -2.0, 0.5])
    x, y = torch.zeros(3), torch.ones(2)

    def energy(_iteration):
        return (3 * (x - goal) ** 2).sum() + (10 * (y + 0.5) ** 2).sum() + 7

    last = descend([(x, 0.1), (y, 0.05)], energy, 200)
    torch.testing.assert_close(x, goal, atol=1e-3, rtol=0)
    torch.testing.assert_close(y, torch.full((2,), -0.5), atol=1e-3, rtol=0)
    assert last == pytest.approx(7, abs=1e-3)
    assert not x.requires_grad


def test_steps_get_smaller_towards_the_end():
    x, places = torch.zeros(1), []

    def slope(_iteration):
        places.append(float(x.detach()))
        return -x.sum()

    descend([(x, 0.1)], slope, 50)
    steps = [b - a for a, b in zip(places, [*places[1:], float(x)], strict=True)]
    assert steps[0] == pytest.approx(0.1, rel=0.01)
    assert steps[-1] < 0.03 * steps[0]


def test_a_frame_without_a_finite_gradient_does_not_poison_the_others():
    x = torch.tensor([1.0, 0.0])

    def energy(_iteration):
        # sqrt at 0 times 0: the second entry's gradient is not a number.
        return (x[0] - 3) ** 2 + (torch.sqrt(x[1]) * 0).sum()

    descend([(x, 0.1)], energy, 100)
    assert x[0].item() == pytest.approx(3, abs=0.05)
    assert torch.isfinite(x).all()


def test_progress_is_told_each_step_and_iterations_are_counted():
    x, told, seen = torch.zeros(1), [], []

    def energy(iteration):
        seen.append(iteration)
        return (x**2).sum()

    descend([(x, 0.1)], energy, 7, told.append)
    assert told == [1] * 7
    assert seen == list(range(7))


def test_a_variable_without_influence_stays():
    x, idle = torch.zeros(1), torch.tensor([4.0])
    descend([(x, 0.1), (idle, 0.1)], lambda _i: ((x - 1) ** 2).sum(), 20)
    assert idle.item() == 4.0
    assert not math.isnan(x.item())
