"""The soft silhouette against its formula written densely, and against pictures."""

import numpy as np
import pytest
import torch

from core_solver.raster import Pinhole
from core_solver.raster.reference import reference_soft_silhouette
from core_solver.raster.soft import soft_silhouette

from .scenes import FIGURE, SMALL, SQUARE_FACES, cosine, picture_of, square, standing

TINY = Pinhole(32, 24, 30.0, 31.0, 15.0, 12.5)


@pytest.mark.parametrize("sigma", [0.3, 2.0])
def test_the_formula_agrees(sigma: float) -> None:
    vertices = standing()[None]
    mask = picture_of(standing(across=0.1), TINY)[None]
    visible = np.random.default_rng(1).random(mask.shape) > 0.1
    loss, gradient = soft_silhouette(vertices, FIGURE.faces, TINY, mask, visible, sigma)
    torch_vertices = torch.tensor(vertices, requires_grad=True)
    reference = reference_soft_silhouette(
        torch_vertices, torch.tensor(FIGURE.faces, dtype=torch.long), TINY, torch.tensor(mask), torch.tensor(visible),
        sigma,
    )  # fmt: skip
    reference.sum().backward()
    assert loss[0] == pytest.approx(reference.item(), rel=1e-5)
    assert torch_vertices.grad is not None
    assert cosine(gradient, torch_vertices.grad.numpy()) > 0.9999


def test_one_triangle_far_from_a_pixel() -> None:
    # Between two rows of the square's upper edge the coverage is sigmoid(+-d^2 / sigma), from the one face there.
    vertices = square(SMALL, 10, 10, 50, 40, 2.0)[None]
    mask = np.zeros((1, 48, 64), bool)
    mask[0, 0, 0] = True
    visible = np.zeros_like(mask)
    visible[0, 9, 40] = visible[0, 0, 0] = True
    loss, _ = soft_silhouette(vertices, [SQUARE_FACES[1]], SMALL, mask, visible, 1.0)
    coverage = 1 / (1 + np.exp(0.25))
    assert loss[0] == pytest.approx(coverage**2 + 1, rel=1e-4)


def test_a_sharp_one_counts_pixels() -> None:
    vertices, mask = square(SMALL, 10, 10, 50, 40, 2.0)[None], np.zeros((1, 48, 64), bool)
    mask[0, 10:40, 20:50] = True
    loss, _ = soft_silhouette(vertices, SQUARE_FACES, SMALL, mask, np.ones_like(mask), 1e-3)
    # The pixels on the diagonal, where both faces end, are no pixel's doubt: each is inside one or on the edge.
    assert loss[0] == pytest.approx(10 * 30 / 900, abs=0.02)


def test_nothing_to_compare() -> None:
    mask = picture_of(standing(), SMALL)[None]
    nowhere, everywhere = np.zeros_like(mask), np.ones_like(mask)
    behind = standing() + np.array([0, 0, -9])
    for vertices, seen, expected in ((standing(), nowhere, 0), (behind, everywhere, 1), (standing() * np.nan, mask, 1)):
        loss, gradient = soft_silhouette(vertices[None], FIGURE.faces, SMALL, mask, seen, 1.0)
        assert loss.tolist() == [expected]
        assert not gradient.any()
