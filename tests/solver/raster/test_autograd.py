"""The operator as a torch function."""

import numpy as np
import torch

from core_solver.raster import solve_terms
from core_solver.raster.autograd import raster_terms

from .scenes import FIGURE, SMALL, picture_of, standing


def test_torch_sees_the_stored_gradients() -> None:
    vertices = np.stack([standing(3.0), standing(3.0, -0.3)])[None]
    labels = (picture_of(standing(across=0.1), SMALL) * np.uint8(4))[None]
    labels[0, :, :20] *= 2
    tensor = torch.tensor(vertices, dtype=torch.float64, requires_grad=True)
    log_depth, silhouette, pixels = raster_terms(tensor, FIGURE.faces, SMALL, labels, [4, 8])
    terms = solve_terms(vertices, FIGURE.faces, SMALL, labels, [4, 8])
    assert log_depth.dtype == torch.float64
    assert np.array_equal(log_depth.detach().numpy(), terms.log_depth)
    assert np.array_equal(pixels.numpy(), terms.pixels)
    weights = torch.tensor([[2.0, 3.0]])
    (weights * log_depth - 5 * silhouette).sum().backward()
    expected = weights.numpy()[..., None, None] * terms.log_depth_gradient - 5 * terms.silhouette_gradient
    assert tensor.grad is not None
    np.testing.assert_allclose(tensor.grad.numpy(), expected, rtol=1e-6)
    assert np.abs(expected).max() > 0
