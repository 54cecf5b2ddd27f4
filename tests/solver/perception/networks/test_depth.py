"""Depth networks of every signature, and the field of view that some of them see."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx import helper

from core_solver.errors import ModelError
from core_solver.perception.disparity import DisparityNetwork
from core_solver.perception.networks.declared import open_declared
from core_solver.perception.networks.depth import DeclaredDepth, fit_focal, focal_view, inverse, read_points
from core_solver.perception.store import ModelStore
from tests.solver.perception.networks.graphs import declare, save, write_answers, write_grey_network


def opened(toml: Path) -> DeclaredDepth:
    depth = open_declared([toml], ModelStore(toml.parent), "cpu").depth
    assert depth is not None
    return depth


def ramp(height: int = 90, width: int = 160) -> np.ndarray:
    """Brighter to the right."""
    row = np.linspace(0, 255, width).round().astype(np.uint8)
    return np.repeat(np.repeat(row[None, :, None], height, 0), 3, 2)


@pytest.mark.parametrize("channel", [False, True])
@pytest.mark.parametrize("sides", [[64, 96], ["h", "w"]])
def test_disparity_is_near_where_large(tmp_path: Path, sides: list, channel: bool) -> None:
    write_grey_network(tmp_path / "midas.onnx", sides, channel=channel, name="disparity")
    toml = declare(tmp_path / "midas.toml", task="depth", decoder="disparity", longer_side=96, multiple=32)
    seen = opened(toml)(ramp())
    assert seen.dtype == np.float16
    assert seen.shape == (64, 96)
    assert (seen.min(), seen.max()) == (0, 1)
    assert (np.diff(seen.mean(axis=0).astype(float)) >= 0).all()


def test_metric_depth_is_far_where_large_and_linear_in_its_inverse(tmp_path: Path) -> None:
    write_grey_network(tmp_path / "metric.onnx", [64, 96])
    toml = declare(tmp_path / "metric.toml", task="depth", decoder="metric-depth", scale=0.01, mean=[-1] * 3)
    network = opened(toml)
    picture = network.look(ramp(64, 96))
    grey = ramp(64, 96)[0, :, 0] / 100 + 2
    np.testing.assert_allclose(picture.inverse_depth[0], 1 / grey, rtol=1e-4)
    assert picture.field_of_view is None
    seen = network(ramp(64, 96)).astype(float)
    assert seen[0, 0] == 1
    assert seen[0, -1] == 0


@pytest.mark.parametrize(
    ("unit", "value"),
    [("pixels", 80.0), ("fov-degrees", 2 * math.degrees(math.atan(48 / 80))), ("fov-radians", 2 * math.atan(48 / 80))],
)
def test_the_focal_length_of_a_metric_network(tmp_path: Path, unit: str, value: float) -> None:
    depth = np.full((1, 64, 96), 3.0)
    write_answers(tmp_path / "pro.onnx", [1, 3, 64, 96], predicted_depth=depth, focallength_px=np.array([value]))
    toml = declare(tmp_path / "pro.toml", task="depth", decoder="metric-depth", focal=unit)
    # 80 pixels of a 96 wide input are 0.833 of the width.
    wide = opened(toml).look(np.zeros((90, 160, 3), np.uint8)).field_of_view
    assert wide == pytest.approx(math.degrees(2 * math.atan(0.5 / (80 / 96))))
    tall = opened(toml).look(np.zeros((160, 90, 3), np.uint8)).field_of_view
    assert tall == pytest.approx(math.degrees(2 * math.atan(0.5 * 160 / 90 / (80 / 96))))


def test_senseless_focal_lengths_are_none() -> None:
    assert focal_view(0.0, "pixels", (160, 90), 96) is None
    assert focal_view(float("nan"), "pixels", (160, 90), 96) is None
    assert focal_view(200.0, "fov-degrees", (160, 90), 96) is None


def scene(picture: tuple[int, int], grid: tuple[int, int], view: float) -> np.ndarray:
    """(h, w, 3) points of a room seen by a camera with this field of view along the longer side of the picture."""
    width, height = picture
    columns, rows = grid
    focal = max(picture) / (2 * math.tan(math.radians(view) / 2))
    x = ((np.arange(columns) + 0.5) / columns - 0.5) * width / focal
    y = ((np.arange(rows) + 0.5) / rows - 0.5) * height / focal
    x, y = np.meshgrid(x, y)
    depth = np.clip(1.4 / np.maximum(y, 0.1), 2, 7) + 0.8 * np.sin(4 * x)
    return np.stack([x * depth, y * depth, depth], axis=-1)


@pytest.mark.parametrize("picture", [(160, 90), (90, 160)])
@pytest.mark.parametrize(("shift", "view"), [(0.0, 50.0), (-1.7, 75.0), (2.5, 30.0)])
@pytest.mark.parametrize("first", [False, True])
def test_points_tell_field_of_view_and_depth(
    tmp_path: Path, picture: tuple[int, int], shift: float, view: float, first: bool
) -> None:
    points = scene(picture, (96, 64), view)
    depth = points[..., 2].copy()
    points[..., 2] += shift
    points[:10, :10] = np.inf
    given = points.transpose(2, 0, 1) if first else points
    mask = np.ones((64, 96))
    mask[:5] = 0
    write_answers(tmp_path / "moge.onnx", [1, 3, 64, 96], points=given[None], mask=mask[None])
    toml = declare(tmp_path / "moge.toml", task="depth", decoder="points")
    seen = opened(toml).look(np.zeros((picture[1], picture[0], 3), np.uint8))
    assert seen.field_of_view == pytest.approx(view, rel=2e-3)
    assert np.isnan(seen.inverse_depth[:5]).all()
    assert np.isnan(seen.inverse_depth[:10, :10]).all()
    np.testing.assert_allclose(seen.inverse_depth[10:], 1 / depth[10:], rtol=5e-3)


def test_points_without_shift_are_taken_as_they_are() -> None:
    points = scene((160, 90), (96, 64), 60)
    seen = read_points(points[None], None, (160, 90), shifted=False)
    assert seen.field_of_view == pytest.approx(60, rel=1e-3)
    np.testing.assert_allclose(seen.inverse_depth, 1 / points[..., 2], rtol=1e-5)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.4, 3), st.floats(-3, 3), st.integers(0, 99))
def test_focal_length_and_shift_are_found_again(focal: float, shift: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pixels = rng.uniform(-0.5, 0.5, (200, 2))
    depth = rng.uniform(1, 6, 200)
    points = np.column_stack([pixels * depth[:, None] / focal, depth - shift])
    found = fit_focal(points, pixels, shifted=True)
    assert found == pytest.approx((focal, shift), rel=1e-3, abs=1e-3)


def test_pictures_without_surface(tmp_path: Path) -> None:
    points = np.full((1, 64, 96, 3), np.nan)
    seen = read_points(points, None, (160, 90), shifted=True)
    assert seen.field_of_view is None
    assert np.isnan(seen.inverse_depth).all()
    assert np.isnan(inverse(np.zeros((4, 4), np.float32))).all()
    write_answers(tmp_path / "moge.onnx", [1, 3, 64, 96], points=points)
    assert (opened(declare(tmp_path / "moge.toml", task="depth", decoder="points"))(ramp()) == 0).all()


def test_zero_and_endless_depth_are_no_surface() -> None:
    depth = np.float32([[2, 0, -1, np.inf, np.nan, 1e-9, 4]])
    np.testing.assert_allclose(inverse(depth), [[0.5, np.nan, np.nan, np.nan, np.nan, np.nan, 0.25]])


def test_networks_that_fail_while_they_run(tmp_path: Path) -> None:
    nodes = [
        helper.make_node("MatMul", ["picture", "weights"], ["wide"]),
        helper.make_node("ReduceMean", ["wide", "axes"], ["depth"], keepdims=0),
    ]
    constants = {"weights": np.ones((96, 96), np.float32), "axes": np.array([1], np.int64)}
    save(tmp_path / "a.onnx", nodes, {"picture": [1, 3, "h", "w"]}, {"depth": [1, "h", "v"]}, constants)
    toml = declare(tmp_path / "a.toml", task="depth", decoder="disparity", input=[64, 48])
    with pytest.raises(ModelError, match=r"a.onnx does not run on \(1, 3, 48, 64\)"):
        opened(toml)(ramp())


@pytest.mark.shared
def test_the_real_network_sees_declared_what_it_sees_by_default(shared_data: Path, tmp_path: Path) -> None:
    file = shared_data / "models" / "tcmonodepth_small_256x448.onnx"
    if not file.is_file():
        pytest.skip("the depth network is not there")
    toml = declare(tmp_path / "tc.toml", task="depth", decoder="disparity", file=str(file), input=[448, 256])
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 255, (27, 48, 3)).astype(np.uint8).repeat(20, 0).repeat(20, 1)
    seen = opened(toml)(picture)
    np.testing.assert_array_equal(seen, DisparityNetwork(file)(picture))
    assert seen.shape == (256, 448)
    with pytest.raises(ModelError, match=r"declared is \(1, 3, 192, 320\)"):
        opened(declare(tmp_path / "tc.toml", task="depth", decoder="disparity", file=str(file), input=[320, 192]))
