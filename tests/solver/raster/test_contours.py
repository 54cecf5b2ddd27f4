"""Outlines against closed forms."""

import numpy as np
import pytest

from core_solver.raster import Contours, Pinhole, contours

from .scenes import FIGURE, SIZED, SQUARE_FACES, disc, picture_of, square, standing

GRID = Pinhole(100, 80, 90.0, 70.0, 48.0, 41.0)


def of_disc(radius: float, mask_radius: float, **options: int) -> tuple[Contours, np.ndarray]:
    vertices, faces = disc(GRID, 50.0, 40.0, radius, 3.0)
    u, v = np.meshgrid(np.arange(100) + 0.5, np.arange(80) + 0.5)
    labels = (np.hypot(u - 50, v - 40) < mask_radius).astype(np.uint8)[None]
    return contours(vertices[None, None], faces, GRID, labels, [1], **options), labels


@pytest.mark.parametrize(("radius", "mask_radius"), [(20, 24), (24, 20), (20, 20.5), (20, 20)])
def test_a_disc_before_another_disc(radius: float, mask_radius: float) -> None:
    found, _ = of_disc(radius, mask_radius, samples=1000)
    used = found.weight[0, 0] > 0
    assert used.sum() > 150
    outwards = (found.target - found.here)[0, 0]
    # Outwards is away from the centre; along a normal the distance is the difference of radii.
    centre = np.where(found.axis[0, 0] == 0, 50, 40)
    outwards = np.where(found.here[0, 0] > centre, outwards, -outwards)[used]
    assert np.median(outwards) == pytest.approx(mask_radius - radius, abs=1.5)
    assert (np.sign(outwards) * np.sign(mask_radius - radius) >= 0).mean() > 0.95
    area = np.pi * abs(mask_radius**2 - radius**2)
    disagreement = (found.weight * np.abs(found.target - found.here)).sum()
    assert disagreement == pytest.approx(area, rel=0.2, abs=30)


@pytest.mark.parametrize("samples", [24, 48, 96])
def test_a_sample_stands_for_the_whole_outline(samples: int) -> None:
    found, _ = of_disc(20, 24, samples=samples)
    assert found.weight.shape == (1, 1, samples)
    area = np.pi * (24**2 - 20**2)
    assert (found.weight * np.abs(found.target - found.here)).sum() == pytest.approx(area, rel=0.2)
    # All sides are seen: left, right, top and bottom.
    side = found.axis[0, 0] * 2 + (found.here[0, 0] > np.where(found.axis[0, 0] == 0, 50, 40))
    assert np.bincount(side, minlength=4).min() >= samples / 8


def test_a_square_beside_its_mask() -> None:
    vertices = square(GRID, 30, 20, 60, 50, 2.0)
    labels = np.zeros((1, 80, 100), np.uint8)
    labels[0, 20:50, 34:64] = 5
    found = contours(vertices[None, None], SQUARE_FACES, GRID, labels, [5], samples=1000)
    used = found.weight[0, 0] > 0.99
    across = used & (found.axis[0, 0] == 0)
    assert np.unique(found.here[0, 0][across]).tolist() == [30.5, 59.5]
    assert np.all((found.target - found.here)[0, 0][across] == 4)
    down = used & (found.axis[0, 0] == 1)
    # Of the upper and lower edge, the part in the mask fits; the part beside it would go inwards, but too far.
    assert np.all((found.target - found.here)[0, 0][down] == 0)
    assert 46 <= down.sum() <= 52


def test_points_lie_on_the_body_and_project_where_they_say() -> None:
    vertices = standing()
    labels = picture_of(standing(3.0, 0.08), SIZED)[None].astype(np.uint8)
    found = contours(vertices[None, None], FIGURE.faces, SIZED, labels, [1])
    assert (found.weight > 0).mean() > 0.8
    assert (found.barycentric >= -1e-3).all()
    assert found.barycentric.sum(-1) == pytest.approx(np.ones((1, 1, 48)), abs=1e-5)
    points = (vertices[FIGURE.faces[found.face]] * found.barycentric[..., None]).sum(-2)
    pixels = points[..., :2] / points[..., 2:] * (SIZED.fx, SIZED.fy) + (SIZED.cx, SIZED.cy)
    along = np.where(found.axis == 0, pixels[..., 0], pixels[..., 1])
    np.testing.assert_allclose(along, found.here, atol=1e-3)


def test_walks_have_a_reach() -> None:
    near, _ = of_disc(20, 29, samples=1000)
    short, _ = of_disc(20, 29, samples=1000, reach_px=5)
    assert near.weight.sum() > 50
    assert short.weight.sum() == 0
    assert np.array_equal(short.target, short.here)


def test_a_gap_is_closed_from_both_sides() -> None:
    # Two legs 6 pixels apart before one solid mask: each may grow by half of the gap.
    legs = np.concatenate([square(GRID, 30, 20, 40, 60, 2.0), square(GRID, 46, 20, 56, 60, 2.0)])
    faces = [*SQUARE_FACES, [4, 5, 6], [4, 6, 7]]
    labels = np.zeros((1, 80, 100), np.uint8)
    labels[0, 20:60, 30:56] = 1
    found = contours(legs[None, None], faces, GRID, labels, [1], samples=1000)
    inner = (found.axis == 0) & (found.weight > 0.99) & (found.target != found.here)
    assert set(found.here[inner].tolist()) == {39.5, 46.5}
    assert set((found.target - found.here)[inner].tolist()) == {3.0, -3.0}


def test_the_border_of_the_picture_is_no_evidence() -> None:
    vertices = square(GRID, -20, -20, 60, 50, 2.0)
    labels = np.zeros((1, 80, 100), np.uint8)
    labels[0, :50, :60] = 1
    found = contours(vertices[None, None], SQUARE_FACES, GRID, labels, [1], samples=1000)
    used = found.weight[0, 0] > 0
    assert set(found.here[0, 0][used & (found.axis[0, 0] == 0)].tolist()) == {59.5}
    assert set(found.here[0, 0][used & (found.axis[0, 0] == 1)].tolist()) == {49.5}
    # A mask that ends with the picture ends nobody knows where.
    labels[0, :50, :] = 1
    found = contours(vertices[None, None], SQUARE_FACES, GRID, labels, [1], samples=1000, reach_px=60)
    assert not (found.weight[0, 0] * (found.axis[0, 0] == 0))[found.here[0, 0] == 59.5].any()


@pytest.mark.parametrize("broken", ["no mask", "behind", "nan", "unclaimed"])
def test_nothing_to_trace_is_padding(broken: str) -> None:
    vertices = square(GRID, 30, 20, 60, 50, -2.0 if broken == "behind" else np.nan if broken == "nan" else 2.0)
    labels = np.zeros((1, 80, 100), np.uint8)
    labels[0, 20:50, 34:64] = {"no mask": 0, "unclaimed": 255}.get(broken, 1)
    found = contours(vertices[None, None], SQUARE_FACES, GRID, labels, [1])
    assert not found.weight.any()
    assert np.isfinite(found.target).all()
    assert found.barycentric.sum(-1) == pytest.approx(np.ones((1, 1, 48)))
