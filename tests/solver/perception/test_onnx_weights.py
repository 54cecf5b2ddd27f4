"""Networks whose weights lie in other files, written by onnx itself and read by onnxruntime."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, external_data_helper, helper, numpy_helper

from core_solver.errors import ModelError
from core_solver.perception.cache import observation_key
from core_solver.perception.onnx_session import open_session
from core_solver.perception.onnx_weights import with_weights
from core_solver.perception.store import ModelStore
from core_solver.video import VideoClip, open_video
from tests.solver.test_video import write_video

WEIGHTS = np.arange(600, dtype=np.float32)


@pytest.fixture
def clip(tmp_path: Path) -> VideoClip:
    return open_video(write_video(tmp_path / "clip.avi", frames=4))


def outside(name: str, location: str) -> onnx.TensorProto:
    tensor = numpy_helper.from_array(WEIGHTS, name)
    external_data_helper.set_external_data(tensor, location)
    tensor.ClearField("raw_data")
    return tensor


def write_network(path: Path, initializers: list[onnx.TensorProto], *more: onnx.NodeProto) -> Path:
    add = helper.make_node("Add", ["x", "w"], ["y"])
    x, y = (helper.make_tensor_value_info(name, TensorProto.FLOAT, [600]) for name in "xy")
    graph = helper.make_graph([*more, add], "g", [x], [y], initializers)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    path.write_bytes(model.SerializeToString())
    return path


def test_the_key_changes_with_weights_in_a_file_of_any_name(clip: VideoClip, tmp_path: Path) -> None:
    file = write_network(tmp_path / "a.onnx", [outside("w", "some weights.bin")])
    weights = tmp_path / "some weights.bin"
    weights.write_bytes(WEIGHTS.tobytes())
    (given,) = open_session(file).run(None, {"x": np.zeros(600, np.float32)})
    np.testing.assert_array_equal(np.asarray(given), WEIGHTS)
    keys = {observation_key(clip, [file])}
    weights.write_bytes((WEIGHTS + 1).tobytes())
    keys.add(observation_key(clip, [file]))
    (tmp_path / "nobody's.data").write_bytes(b"1")
    (tmp_path / "a.onnx_data").write_bytes(b"1")
    keys.add(observation_key(clip, [file]))
    assert len(keys) == 2


def test_every_place_for_weights_is_known(tmp_path: Path) -> None:
    names = ["attribute", "branch", "initializer", "sub/deep"]
    (tmp_path / "sub").mkdir()
    for name in names:
        (tmp_path / name).write_bytes(WEIGHTS.tobytes())
    inner = helper.make_graph([], "inner", [], [], [outside("b", "branch")])
    nodes = [
        helper.make_node("Constant", [], ["c"], value=outside("c", "attribute")),
        helper.make_node("If", ["x"], ["z"], then_branch=inner, else_branch=helper.make_graph([], "e", [], [])),
    ]
    file = write_network(tmp_path / "a.onnx", [outside("w", "initializer"), outside("v", "sub/deep")], *nodes)
    assert with_weights([file]) == (file, *(tmp_path / name for name in names))


def test_networks_that_are_whole_stand_alone(tmp_path: Path) -> None:
    whole = write_network(tmp_path / "whole.onnx", [numpy_helper.from_array(WEIGHTS, "w")])
    missing = write_network(tmp_path / "missing.onnx", [outside("w", "not there")])
    damaged, other = tmp_path / "damaged.onnx", tmp_path / "a.toml"
    damaged.write_bytes(whole.read_bytes()[:-100])
    other.write_text("[network]")
    assert with_weights([whole, missing, damaged, other]) == (whole, missing, damaged, other)


def test_an_added_network_brings_its_weights(tmp_path: Path) -> None:
    file = write_network(tmp_path / "a.onnx", [outside("w", "far/weights.bin")])
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "weights.bin").write_bytes(WEIGHTS.tobytes())
    store = ModelStore(tmp_path / "store")
    added = store.add(file, "mine", "disparity")
    (given,) = open_session(added).run(None, {"x": np.zeros(600, np.float32)})
    np.testing.assert_array_equal(np.asarray(given), WEIGHTS)
    (tmp_path / "far" / "weights.bin").write_bytes((WEIGHTS + 1).tobytes())
    with pytest.raises(ModelError, match="another network's weights"):
        store.add(file, "other", "disparity")
    assert store.files("disparity") == (added,)


@pytest.mark.parametrize("absolute", [False, True])
def test_weights_outside_the_folder_are_not_touched(tmp_path: Path, absolute: bool) -> None:
    (tmp_path / "secret").write_bytes(b"x")
    (tmp_path / "networks").mkdir()
    place = str(tmp_path / "secret") if absolute else "../secret"
    file = write_network(tmp_path / "networks" / "a.onnx", [outside("w", place)])
    assert with_weights([file]) == (file,)
