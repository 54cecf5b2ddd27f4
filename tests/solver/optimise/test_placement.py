import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from core_solver.optimise.placement import place


def body_points(rng: np.random.Generator, *batch: int) -> np.ndarray:
    return rng.uniform((-0.4, -0.9, -0.3), (0.4, 0.9, 0.3), (*batch, 25, 3))


def rays_to(points: np.ndarray) -> np.ndarray:
    return points[..., :2] / points[..., 2:]


@given(st.floats(1, 50), st.floats(-0.8, 0.8), st.floats(-0.6, 0.6), st.integers(0, 2**32 - 1))
def test_exact_from_one_to_fifty_metres(distance, across, down, seed):
    rng = np.random.default_rng(seed)
    points = body_points(rng)
    truth = np.array([across, down, 1.0]) * distance
    weights = rng.random(25) * (rng.random(25) < 0.6)
    weights[rng.choice(25, 6, replace=False)] = 0.5
    rays = rays_to(points + truth)
    # Where there is no evidence the pixels may lie anywhere.
    rays[weights == 0] = 1e3
    found, good = place(points, rays, weights)
    assert good
    assert np.linalg.norm(found - truth) < 1e-4 * distance


def test_batches_keep_their_shape_and_order():
    rng = np.random.default_rng(0)
    points = body_points(rng, 2, 5)
    truth = rng.uniform((-1, -1, 2), (1, 1, 40), (2, 5, 3))
    found, good = place(points, rays_to(points + truth[..., None, :]), np.ones((2, 5, 25)))
    assert good.shape == (2, 5)
    assert good.all()
    np.testing.assert_allclose(found, truth, atol=1e-4)


@pytest.mark.parametrize("distance", [3.0, 30.0])
def test_noise_of_a_pixel_stays_a_small_error(distance):
    """The image error counts, not the metric one: a person's near hand must not decide where they stand."""
    rng = np.random.default_rng(1)
    points = body_points(rng, 200)
    truth = np.array([0.5, 0.2, distance])
    size = 1.8 / distance
    rays = rays_to(points + truth) + rng.normal(size=(200, 25, 2)) * 0.01 * size
    found, good = place(points, rays, np.ones((200, 25)))
    assert good.all()
    assert abs(found[:, 2].mean() / distance - 1) < 0.005
    assert found[:, 2].std() / distance < 0.02


def test_the_place_is_the_one_whose_picture_fits_best():
    """Hands held out towards the camera have less than half the body's depth: their pixels count like the others'."""
    errors = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        points, truth = body_points(rng), np.array([0.2, 0.1, 1.5])
        points[:8, 2] -= 0.9
        rays = rays_to(points + truth) + rng.normal(size=(25, 2)) * 0.01

        def misfit(translation, points=points, rays=rays):
            return (rays_to(points + translation) - rays).ravel()

        best = least_squares(misfit, truth).x
        errors.append(np.linalg.norm(place(points, rays, np.ones(25))[0] - best))
    assert np.mean(errors) < 0.001


def test_a_body_behind_the_camera_is_flagged():
    points = body_points(np.random.default_rng(2))
    truth = np.array([0.3, 0.1, -4.0])
    _, good = place(points, rays_to(points + truth), np.ones(25))
    assert not good


def test_rays_of_a_mirrored_body_are_flagged():
    """Upside-down rays fit a body best from behind the camera."""
    points = body_points(np.random.default_rng(3))
    _, good = place(points, -rays_to(points + np.array([0, 0, 4.0])), np.ones(25))
    assert not good


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_points_are_flagged_and_finite(count):
    points = body_points(np.random.default_rng(4))
    weights = np.zeros(25)
    weights[:count] = 1
    found, good = place(points, rays_to(points + np.array([0, 0, 4.0])), weights)
    assert not good
    assert np.isfinite(found).all()


def test_one_frame_without_evidence_does_not_touch_the_next():
    points = body_points(np.random.default_rng(5), 2)
    rays, weights = rays_to(points + np.array([0, 0, 6.0])), np.ones((2, 25))
    rays[0], weights[0] = 0, 0
    found, good = place(points, rays, weights)
    assert good.tolist() == [False, True]
    np.testing.assert_allclose(found[1], (0, 0, 6), atol=1e-7)
