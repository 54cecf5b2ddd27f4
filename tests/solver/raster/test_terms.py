"""The fused operator against closed forms, the torch reference and finite differences."""

import numba
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.raster import Pinhole, RasterTerms, fused, solve_terms
from core_solver.raster.mannequin import PARAMETERS, build_mannequin
from core_solver.raster.reference import antialiased_silhouette, reference_terms

from .scenes import FIGURE, SIZED, SMALL, SQUARE_FACES, cosine, picture_of, square, standing

GRID = Pinhole(32, 24, 20.0, 30.0, 16.0, 12.0)


def same(a: RasterTerms, b: RasterTerms) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in a.__dataclass_fields__)


def directional(gradient: np.ndarray, move: np.ndarray) -> float:
    return float(np.sum(gradient * move))


# --- closed forms ---


def test_a_square_before_half_its_mask() -> None:
    vertices = square(GRID, 8, 6, 16, 12, 2.5)[None]
    mask = np.zeros((1, 24, 32), bool)
    mask[0, 6:12, 12:24] = True
    terms = fused(vertices, SQUARE_FACES, GRID, mask)
    assert terms.pixels[0] == 4 * 6
    assert terms.log_depth[0] == pytest.approx(np.log(2.5), rel=1e-6)
    assert terms.silhouette[0] == pytest.approx((4 * 6 + 8 * 6) / (12 * 6))
    # Farther away by dz, all depths grow by dz / z.
    assert directional(terms.log_depth_gradient[0], np.array([0, 0, 1])) == pytest.approx(1 / 2.5, rel=1e-5)
    # One metre to the right is fx / z pixels, each of which uncovers a wrong column and covers a right one.
    to_the_right = directional(terms.silhouette_gradient[0], np.array([1, 0, 0]))
    assert to_the_right == pytest.approx(-(6 + 6) / 72 * 20 / 2.5, rel=1e-5)
    assert directional(terms.silhouette_gradient[0], np.array([0, 1, 0])) == pytest.approx(0, abs=1e-6)


def test_pixels_that_are_no_evidence_do_not_count() -> None:
    vertices = square(GRID, 8, 6, 16, 12, 2.5)[None]
    mask, visible = np.zeros((1, 24, 32), bool), np.ones((1, 24, 32), bool)
    mask[0, 6:12, 8:24] = True
    visible[0, :, 14:] = False
    terms = fused(vertices, SQUARE_FACES, GRID, mask, visible)
    assert terms.pixels[0] == 6 * 6
    assert terms.silhouette[0] == 0
    # Nothing is known of the right edge; the left one fits, and both ends of a fit pull equally.
    assert directional(terms.silhouette_gradient[0], np.array([1, 0, 0])) == pytest.approx(0, abs=1e-6)


def test_a_slanted_plane_shifts_its_depth_along_the_picture() -> None:
    vertices = square(GRID, 8, 6, 24, 18, 1.0)
    z = 2 + 0.1 * (vertices[:, 0] > 0)
    vertices = (vertices * z[:, None])[None]
    mask = np.ones((1, 24, 32), bool)
    torch_vertices = torch.tensor(vertices, requires_grad=True)
    everywhere = torch.ones(1, 24, 32, dtype=torch.bool)
    reference = reference_terms(torch_vertices, torch.tensor(SQUARE_FACES), GRID, everywhere, everywhere)
    reference.log_depth.sum().backward()
    terms = fused(vertices, SQUARE_FACES, GRID, mask)
    np.testing.assert_allclose(terms.log_depth_gradient, torch_vertices.grad, rtol=1e-4, atol=1e-6)


# --- against the reference and finite differences ---


@pytest.mark.parametrize("depth", [1.5, 3.0, 12.0])
def test_the_reference_agrees(depth: float) -> None:
    vertices = standing(depth)[None]
    mask = picture_of(standing(depth, across=0.1), SMALL)[None]
    visible = np.random.default_rng(1).random(mask.shape) > 0.1
    terms = fused(vertices, FIGURE.faces, SMALL, mask, visible)
    torch_vertices = torch.tensor(vertices, requires_grad=True)
    reference = reference_terms(
        torch_vertices, torch.tensor(FIGURE.faces, dtype=torch.long), SMALL, torch.tensor(mask), torch.tensor(visible)
    )
    reference.log_depth.sum().backward()
    assert terms.pixels[0] == int(reference.pixels)
    assert terms.log_depth[0] == pytest.approx(reference.log_depth.item(), rel=1e-5)
    assert terms.silhouette[0] == pytest.approx(reference.silhouette.item(), rel=1e-6)
    assert torch_vertices.grad is not None
    assert cosine(terms.log_depth_gradient, torch_vertices.grad.numpy()) > 0.9999


def parameter_slopes(loss, parameters: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Central differences, per step, so that metres and radians weigh the same in the picture."""
    return np.array([loss(parameters + step) - loss(parameters - step) for step in np.diag(steps)]) / 2


def test_gradients_agree_with_finite_differences() -> None:
    figure, pinhole = build_mannequin(2000), Pinhole(512, 288, 420.0, 420.0, 256.0, 144.0)
    parameters = np.full(PARAMETERS, 0.15)
    parameters[:3] = 0.0, 0.0, 3.9
    # A few pixels away: where outlines coincide the loss has a kink and no slope.
    elsewhere = parameters + np.array([0.05, 0.03, 0.1, *np.full(PARAMETERS - 3, 0.06)])
    mask = picture_of(figure.posed(elsewhere), pinhole, figure.faces)[None]
    seen = np.ones_like(mask)
    # Each step moves the picture by about half a pixel.
    steps = np.array([0.005, 0.005, 0.025, *np.full(PARAMETERS - 3, 0.012)])

    def loss(values: np.ndarray) -> float:
        return float(antialiased_silhouette(figure.posed(values)[None], figure.faces, pinhole, mask, seen, 4)[0])

    gradient = fused(figure.posed(parameters)[None], figure.faces, pinhole, mask, seen).silhouette_gradient[0]
    moves = parameter_slopes(figure.posed, parameters, steps)
    ours = np.einsum("vc,pvc->p", gradient, moves)
    truth = parameter_slopes(loss, parameters, steps)
    assert cosine(ours[:3], truth[:3]) > 0.999
    assert cosine(ours[3:], truth[3:]) > 0.99


@settings(max_examples=25, deadline=None)
@given(st.floats(1.2, 20), st.floats(-1, 1), st.integers(0, 100))
def test_farther_bodies_are_deeper_by_the_same_factor(depth: float, across: float, seed: int) -> None:
    mask = np.random.default_rng(seed).random((1, SMALL.height, SMALL.width)) > 0.5
    near = standing(depth, across)[None]
    terms, farther = (fused(scale * near, FIGURE.faces, SMALL, mask) for scale in (1, 2))
    assert np.array_equal(terms.pixels, farther.pixels)
    assert farther.log_depth[0] == pytest.approx(terms.log_depth[0] + (terms.pixels[0] > 0) * np.log(2), abs=1e-5)
    # So scaling everything changes the mean log depth by exactly 1 a unit of log scale, and the silhouette not at all.
    assert directional(terms.log_depth_gradient, near) == pytest.approx(float(terms.pixels[0] > 0), abs=1e-3)
    assert directional(terms.silhouette_gradient, near) == pytest.approx(0, abs=2e-3 * (1 + terms.silhouette[0]))


# --- a whole clip ---


def test_one_person_alone_is_the_fused_operator() -> None:
    mask = picture_of(standing(3.0, 0.1), SIZED)
    alone = fused(standing()[None], FIGURE.faces, SIZED, mask[None])
    clip = solve_terms(standing()[None, None], FIGURE.faces, SIZED, mask[None] * np.uint8(7), [7])
    for name in alone.__dataclass_fields__:
        assert np.array_equal(getattr(clip, name)[:, 0], getattr(alone, name))


def test_neither_runs_nor_threads_change_a_bit() -> None:
    vertices = np.stack([np.stack([standing(3 + 0.1 * t, 0.1), standing(3, -0.1)]) for t in range(6)])
    labels = np.random.default_rng(0).integers(0, 3, (6, SIZED.height, SIZED.width)).astype(np.uint8)
    before = numba.get_num_threads()
    runs = []
    try:
        for threads in (1, before, before, 1):
            numba.set_num_threads(threads)
            runs.append(solve_terms(vertices, FIGURE.faces, SIZED, labels, [1, 2]))
    finally:
        numba.set_num_threads(before)
    assert all(same(run, runs[0]) for run in runs[1:])


# --- nothing to compare ---


def check_zeros(terms: RasterTerms, silhouette: float) -> None:
    assert not terms.log_depth.any()
    assert not terms.pixels.any()
    assert not terms.log_depth_gradient.any()
    assert not terms.silhouette_gradient.any()
    assert (terms.silhouette == silhouette).all()


def test_no_mask_is_no_evidence() -> None:
    nothing = np.zeros((1, SMALL.height, SMALL.width), bool)
    check_zeros(fused(standing()[None], FIGURE.faces, SMALL, nothing), 0)
    check_zeros(fused(standing()[None], FIGURE.faces, SMALL, ~nothing, nothing), 0)
    check_zeros(solve_terms(standing()[None, None], FIGURE.faces, SMALL, nothing.astype(np.uint8), [1]), 0)


@pytest.mark.parametrize("place", ["behind", "nan", "beside", "above", "on the lens"])
def test_a_body_out_of_sight_misses_all_its_mask(place: str) -> None:
    move = {
        "behind": [0, 0, -9.0], "nan": [np.nan, 0, 0], "beside": [30.0, 0, 0], "above": [0, -30.0, 0],
        "on the lens": [0, 0, -2.999],
    }[place]  # fmt: skip
    vertices = standing() * (0.001 if place == "on the lens" else 1) + move
    mask = picture_of(standing(), SMALL)[None]
    check_zeros(fused(vertices[None], FIGURE.faces, SMALL, mask), 1)
    check_zeros(solve_terms(vertices[None, None], FIGURE.faces, SMALL, mask * np.uint8(1), [1]), 1)


def test_one_broken_vertex_costs_only_its_faces() -> None:
    vertices = standing()
    mask = picture_of(vertices, SIZED)[None]
    whole = fused(vertices[None], FIGURE.faces, SIZED, mask)
    vertices[np.argmin(vertices[:, 2])] = np.nan
    broken = fused(vertices[None], FIGURE.faces, SIZED, mask)
    assert whole.pixels[0] - 60 < broken.pixels[0] < whole.pixels[0]
    assert np.isfinite(broken.log_depth_gradient).all()
    assert np.isfinite(broken.silhouette_gradient).all()


def test_no_frames_and_nobody() -> None:
    assert solve_terms(np.zeros((0, 2, 502, 3)), FIGURE.faces, SMALL, np.zeros((0, 48, 64)), [1, 2]).pixels.shape == (
        0,
        2,
    )
    assert solve_terms(np.zeros((3, 0, 502, 3)), FIGURE.faces, SMALL, np.zeros((3, 48, 64)), []).pixels.shape == (3, 0)


def test_pictures_and_ids_must_fit() -> None:
    with pytest.raises(ValueError, match="shape"):
        fused(standing()[None], FIGURE.faces, SMALL, np.zeros((1, 64, 48)))
    for ids in ([1], [1, 1], [0, 1], [1, 255]):
        with pytest.raises(ValueError, match="label"):
            solve_terms(np.zeros((1, 2, 502, 3)), FIGURE.faces, SMALL, np.zeros((1, 48, 64)), ids)
