"""The adapter on tiny networks built here, and the sharpening on edges of known place."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import TensorProto, helper

from core_solver.errors import ModelError
from core_solver.perception.disparity import (
    CONVENTIONS,
    DisparityNetwork,
    convention_for,
    disparity_files,
    free_size,
    nearest_shape,
    normalise,
    open_disparity,
    sharpen_edges,
    to_tensor,
)


def write_network(
    path: Path, sides: list[int | str], keep_channel: bool = False, kind: int = TensorProto.FLOAT, channels: int = 3
) -> Path:
    """A network whose "disparity" is the mean of the channels."""
    nodes = [helper.make_node("ReduceMean", ["x", "axes"], ["y"], keepdims=int(keep_channel))]
    graph = helper.make_graph(
        nodes, "tiny",
        [helper.make_tensor_value_info("x", kind, [1, channels, *sides])],
        [helper.make_tensor_value_info("y", kind, None)],
        [helper.make_tensor("axes", TensorProto.INT64, [1], [1])],
    )  # fmt: skip
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), path)
    return path


def ramp(height: int = 90, width: int = 160) -> np.ndarray:
    """Brighter to the right."""
    row = np.linspace(0, 255, width).round().astype(np.uint8)
    return np.repeat(np.repeat(row[None, :, None], height, 0), 3, 2)


@pytest.mark.parametrize("keep_channel", [False, True])
@pytest.mark.parametrize("sides", [[64, 96], ["h", "w"]])
def test_size_is_read_from_the_graph_and_near_is_large(tmp_path: Path, sides, keep_channel: bool) -> None:
    network = DisparityNetwork(write_network(tmp_path / "midas_tiny.onnx", sides, keep_channel))
    disparity = network(ramp())
    assert disparity.dtype == np.float16
    assert disparity.shape == ((64, 96) if sides == [64, 96] else (224, 384))
    assert disparity.min() == 0
    assert disparity.max() == 1
    assert np.all(np.diff(disparity.mean(axis=0).astype(float)) >= 0)


def test_half_precision_networks_run(tmp_path: Path) -> None:
    network = DisparityNetwork(write_network(tmp_path / "midas.onnx", [64, 96], kind=TensorProto.FLOAT16))
    assert network(ramp()).shape == (64, 96)


def test_each_family_gets_its_own_normalisation() -> None:
    picture = np.full((8, 8, 3), (10, 100, 200), np.uint8)  # BGR
    plain = to_tensor(picture, 8, 8, convention_for(Path("TCMonoDepth_small_8x8.onnx")))
    np.testing.assert_array_equal(plain[0, :, 0, 0], [200, 100, 10])
    usual = to_tensor(picture, 8, 8, convention_for(Path("depth_anything_v2_small.onnx")))
    expected = (np.array([200, 100, 10]) / 255 - (0.485, 0.456, 0.406)) / (0.229, 0.224, 0.225)
    np.testing.assert_allclose(usual[0, :, 0, 0], expected, rtol=1e-5)
    assert convention_for(Path("MiDaS_v21_small.onnx")).std == CONVENTIONS[-1].std
    assert convention_for(Path("midas_dpt_hybrid.onnx")).mean == (0.5, 0.5, 0.5)
    # As the store names what it fetches: MiDaS's own file normalises by itself, the other is told by its folder.
    assert convention_for(Path("midas-v2.1-small/model-small.onnx")).std == (1, 1, 1)
    assert convention_for(Path("depth-anything-v2-small/model.onnx")).multiple == 14


@given(st.integers(64, 4000), st.integers(64, 4000))
def test_free_sizes_are_multiples_near_the_pictures_shape(width: int, height: int) -> None:
    for convention in CONVENTIONS:
        rows, columns = free_size(width, height, convention)
        assert rows % convention.multiple == columns % convention.multiple == 0
        assert min(rows, columns) > 0
        assert abs(max(rows, columns) - convention.long_side) <= convention.multiple


def test_the_shape_nearest_the_video_is_chosen(tmp_path: Path) -> None:
    shapes = ("192x320", "256x352", "256x448", "448x256")
    files = [tmp_path / f"tcmonodepth_small_{s}.onnx" for s in shapes]
    assert nearest_shape(files, 1920 / 1080).name.endswith("256x448.onnx")
    assert nearest_shape(files, 1088 / 1920).name.endswith("448x256.onnx")
    assert nearest_shape(files, 768 / 576).name.endswith("256x352.onnx")
    for file, shape in zip(files, shapes, strict=True):
        write_network(file, [int(n) for n in shape.split("x")])
    chosen = open_disparity(disparity_files(tmp_path), 1088, 1920)
    assert chosen is not None
    assert chosen(ramp(192, 108)).shape == (448, 256)


def test_without_files_there_is_no_depth(tmp_path: Path) -> None:
    assert open_disparity((), 640, 480) is None
    for nothing in (tmp_path, tmp_path / "missing.onnx"):
        with pytest.raises(ModelError, match="no depth network"):
            disparity_files(nothing)


def test_networks_of_another_kind_are_refused_with_the_reason(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    grey = write_network(tmp_path / "grey.onnx", [64, 64], channels=1)
    with pytest.raises(ModelError, match=r"takes .*1, 1, 64, 64"):
        DisparityNetwork(grey)
    whole = write_network(tmp_path / "int.onnx", [64, 64], kind=TensorProto.INT32)
    with pytest.raises(ModelError, match="int32"):
        DisparityNetwork(whole)
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"\x00" * 100)
    caplog.clear()
    with pytest.raises(ModelError, match="fetch it again"):
        DisparityNetwork(broken)
    assert not caplog.records, "no word on the picture's normalisation of a file that is no network"
    graph = helper.make_graph(
        [helper.make_node("Identity", ["x"], ["y"])], "colour",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 3, 64, 64])],
        [helper.make_tensor_value_info("y", TensorProto.FLOAT, None)],
    )  # fmt: skip
    colour = tmp_path / "midas_colour.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), colour)
    with pytest.raises(ModelError, match="one value per pixel"):
        DisparityNetwork(colour)(ramp())


@given(st.floats(0.01, 1e4), st.floats(-1e3, 1e3))
def test_scale_and_shift_do_not_matter(scale: float, shift: float) -> None:
    raw = np.random.default_rng(3).random((40, 50)).astype(np.float32)
    np.testing.assert_allclose(normalise(raw * np.float32(scale) + np.float32(shift)), normalise(raw), atol=0.02)


def test_wild_and_missing_values_do_not_set_the_range() -> None:
    raw = np.random.default_rng(3).random((100, 100)).astype(np.float32)
    wild = raw.copy()
    wild[0, :20], wild[1, 0] = 1e6, np.nan
    calm = normalise(wild)
    assert np.isfinite(calm).all()
    np.testing.assert_allclose(calm[2:], normalise(raw)[2:], atol=0.02)
    assert normalise(np.full((9, 9), 7, np.float32)).max() == 0
    assert normalise(np.full((9, 9), np.nan, np.float32)).max() == 0


def blurred_step(blur: int, low: float, high: float, edge: int = 60, width: int = 128) -> np.ndarray:
    across = np.clip((np.arange(width) + 0.5 - edge) / blur + 0.5, 0, 1)
    return np.repeat((low + (high - low) * across)[None], 96, 0).astype(np.float32)


@pytest.mark.parametrize("blur", [1, 2, 3, 4])
@pytest.mark.parametrize(("low", "high"), [(0.2, 0.9), (0.8, 0.3)])
def test_a_blurred_edge_becomes_a_step_in_its_middle(blur: int, low: float, high: float) -> None:
    sharp = sharpen_edges(blurred_step(blur, low, high))
    np.testing.assert_allclose(sharp[:, :59], low, atol=1e-6)
    np.testing.assert_allclose(sharp[:, 61:], high, atol=1e-6)
    between = np.minimum(np.abs(sharp - low), np.abs(sharp - high)) > 1e-6
    assert between.sum() == 0


def test_floors_and_flat_pictures_are_left_alone() -> None:
    floor = np.repeat(np.linspace(0, 1, 128)[:, None], 96, 1).astype(np.float32)
    np.testing.assert_array_equal(sharpen_edges(floor), floor)
    noise = np.random.default_rng(0).random((64, 64)).astype(np.float32)
    assert sharpen_edges(noise).shape == noise.shape


@pytest.mark.shared
def test_real_network_sees_the_near_people_nearer_than_the_wall(shared_data: Path) -> None:
    from core_solver.video import open_video

    clip = open_video(shared_data / "clips" / "lab_two_people_cam01.mp4")
    network = open_disparity(disparity_files(shared_data / "models"), clip.width, clip.height)
    assert network is not None
    _, picture = next(iter(clip.frames()))
    disparity = network(picture).astype(float)
    assert disparity.shape == (448, 256)
    height, width = disparity.shape
    floor = disparity[int(0.95 * height), int(0.3 * width)]
    wall = disparity[int(0.12 * height), int(0.5 * width)]
    assert floor > wall + 0.4
