"""Files that are not as declared: the message names the input or output and both shapes."""

from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from onnx import TensorProto, helper

from core_solver.errors import ModelError
from core_solver.perception.networks.session import DeclaredSession, fits
from core_solver.perception.networks.spec import read_spec
from core_solver.perception.onnx_session import providers
from tests.solver.perception.networks.graphs import (
    declare,
    save,
    write_answers,
    write_answers_per_person,
    write_simcc_network,
)

POSE = {"task": "pose", "decoder": "simcc", "input": [96, 128]}
LEVELS = np.arange(17) * 10 + 50


def opened(toml: Path) -> DeclaredSession:
    return DeclaredSession(read_spec(toml), "cpu")


def test_a_network_as_declared_opens(tmp_path: Path) -> None:
    write_simcc_network(tmp_path / "a.onnx", (96, 128), LEVELS)
    session = opened(declare(tmp_path / "a.toml", **POSE))
    assert session.size == (96, 128)
    assert session.batch is None
    outputs = session([np.zeros((3, 128, 96), np.float32)] * 3)
    assert [o.shape for o in outputs if o is not None] == [(3, 17, 96), (3, 17, 128)]


def test_the_size_is_read_from_the_graph_where_nothing_is_declared(tmp_path: Path) -> None:
    write_simcc_network(tmp_path / "a.onnx", (96, 128), LEVELS)
    assert opened(declare(tmp_path / "a.toml", task="pose", decoder="simcc")).size == (96, 128)


@pytest.mark.parametrize("batch", [1, 2, 4])
def test_graphs_of_fixed_batch_see_everybody(tmp_path: Path, batch: int) -> None:
    write_simcc_network(tmp_path / "a.onnx", (96, 128), LEVELS, batch)
    session = opened(declare(tmp_path / "a.toml", **POSE))
    pictures = [np.full((3, 128, 96), 50 + 10 * n, np.float32) for n in range(3)]
    across = session(pictures)[0]
    assert across is not None
    assert across.shape == (3, 17, 96)
    # Each picture is full of one keypoint's level: the answers stay in order.
    np.testing.assert_array_equal(across.max(axis=-1).argmax(axis=-1), [0, 1, 2])


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"a.toml: there is no file .*a.onnx: correct the key 'file'"):
        opened(declare(tmp_path / "a.toml", **POSE))
    (tmp_path / "a.onnx").write_bytes(b"no network")
    with pytest.raises(ModelError, match="no readable ONNX network"):
        opened(declare(tmp_path / "a.toml", **POSE))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"input": [192, 256]}, r"input 'picture' is \(N, 3, 128, 96\), declared is \(any, 3, 256, 192\)"),
        ({"layout": "NHWC"}, r"input 'picture' is \(N, 3, 128, 96\), declared is \(any, 128, 96, 3\)"),
        (
            {"keypoints": "halpe26"},
            r"output 'simcc_x' is \(N, 17, 96\), the decoder \"simcc\" wants \(any, 26, any\) for its x",
        ),
        ({"outputs": {"x": "nowhere"}}, r"has no output 'nowhere' \(outputs.x\): it has simcc_x, simcc_y"),
        ({"constants": {"tokens": 3}}, r"has no input 'tokens', which \[network.constants\] sets: it has picture"),
    ],
)
def test_a_wrong_signature_is_named(tmp_path: Path, change: dict, words: str) -> None:
    write_simcc_network(tmp_path / "a.onnx", (96, 128), LEVELS)
    with pytest.raises(ModelError, match=r"a.onnx is not as a.toml declares: " + words):
        opened(declare(tmp_path / "a.toml", **{**POSE, **change}))


def test_a_network_for_another_task(tmp_path: Path) -> None:
    write_simcc_network(tmp_path / "a.onnx", (96, 128), LEVELS)
    with pytest.raises(
        ModelError, match=r"output 'simcc_x' is .* the decoder \"rtmo\" wants \(1, any, 5\) for its dets"
    ):
        opened(declare(tmp_path / "a.toml", task="pose", decoder="rtmo", outputs={"dets": "simcc_x"}))
    write_answers(tmp_path / "b.onnx", [1, 3, 32, 32], depth=np.zeros((1, 8, 8)))
    with pytest.raises(ModelError, match=r"has only the outputs depth, the decoder \"simcc\" wants x, y$"):
        opened(declare(tmp_path / "b.toml", task="pose", decoder="simcc"))
    with pytest.raises(ModelError, match=r"has the outputs simcc_x, simcc_y: say with outputs.disparity in a.toml"):
        opened(declare(tmp_path / "a.toml", task="depth", decoder="disparity"))


def test_outputs_of_other_names_are_taken_in_order_or_as_named(tmp_path: Path) -> None:
    dets, labels, masks = np.zeros((1, 3, 5)), np.zeros((1, 3)), np.zeros((1, 3, 8, 8))
    write_answers(tmp_path / "a.onnx", [1, 3, 32, 32], b=dets, c=labels, a=masks)
    session = opened(declare(tmp_path / "a.toml", task="masks", decoder="rtmdet-ins"))
    assert [np.shape(o) for o in session([np.zeros((3, 32, 32))])] == [(1, 3, 5), (1, 3), (1, 3, 8, 8)]
    named = {"dets": "b", "labels": "c", "masks": "b"}
    with pytest.raises(ModelError, match=r"output 'b' is \(1, 3, 5\).* wants \(1, any, any, any\) for its masks"):
        opened(declare(tmp_path / "a.toml", task="masks", decoder="rtmdet-ins", outputs=named))


def test_shapes_that_only_show_when_the_network_runs(tmp_path: Path) -> None:
    constants = {"one": np.ones((1, 1, 1), np.float32), "axes": np.array([0, 2, 3], np.int64)}
    nodes = [
        helper.make_node("Shape", ["picture"], ["shape"]),
        helper.make_node("Gather", ["shape", "axes"], ["sides"]),
        helper.make_node("Expand", ["one", "sides"], ["output0"]),
    ]
    save(tmp_path / "a.onnx", nodes, {"picture": [1, 3, "h", "w"]}, {"output0": [1, "h", "w"]}, constants)
    session = opened(declare(tmp_path / "a.toml", task="pose", decoder="yolo-pose", input=[64, 48]))
    with pytest.raises(ModelError, match=r"output 'output0' is \(1, 48, 64\).* wants \(1, 56, any\)"):
        session([np.zeros((3, 48, 64))])


def test_further_inputs_need_their_number(tmp_path: Path) -> None:
    nodes = [helper.make_node("Add", ["answer", "tokens"], ["depth"])]
    inputs = {"picture": [1, 3, 32, 32], "tokens": []}
    save(tmp_path / "a.onnx", nodes, inputs, {"depth": [1, 8, 8]}, {"answer": np.ones((1, 8, 8), np.float32)})
    with pytest.raises(ModelError, match=r"inputs 'picture' \(1, 3, 32, 32\), 'tokens' \(\): one takes the picture"):
        opened(declare(tmp_path / "a.toml", task="depth", decoder="disparity"))
    session = opened(declare(tmp_path / "a.toml", task="depth", decoder="disparity", constants={"tokens": 41}))
    np.testing.assert_array_equal(session([np.zeros((3, 32, 32))])[0], np.full((1, 8, 8), 42))


def test_inputs_of_strange_types_and_free_size(tmp_path: Path) -> None:
    save(
        tmp_path / "a.onnx", [helper.make_node("Identity", ["answer"], ["depth"])], {"picture": [1, 3, 8, 8]},
        {"depth": [1, 8, 8]}, {"answer": np.zeros((1, 8, 8), np.float32)}, TensorProto.BOOL,
    )  # fmt: skip
    with pytest.raises(ModelError, match=r"input 'picture' takes tensor\(bool\)"):
        opened(declare(tmp_path / "a.toml", task="depth", decoder="disparity"))
    write_answers_per_person(tmp_path / "b.onnx", ["N", 3, "h", "w"], x=np.zeros((17, 8)), y=np.zeros((17, 8)))
    with pytest.raises(ModelError, match=r"input 'picture' is \(N, 3, h, w\): say its size with the key 'input'"):
        opened(declare(tmp_path / "b.toml", task="pose", decoder="simcc"))


def test_shapes_fit_where_every_known_length_does() -> None:
    assert fits(["N", 3, None, 96], (-1, 3, 128, 96))
    assert not fits(["N", 3, 127, 96], (-1, 3, 128, 96))
    assert not fits(["N", 3, 128], (-1, 3, 128, 96))


def test_devices(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CPUExecutionProvider"])
    assert providers("auto", "a.onnx") == ["CPUExecutionProvider"]
    assert not caplog.records
    assert providers("cuda", "a.onnx") == ["CPUExecutionProvider"]
    assert "a.onnx runs on the processor: install onnxruntime-gpu" in caplog.text
    both = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: both)
    assert providers("auto", "a.onnx") == providers("cuda", "a.onnx") == both
    assert providers("cpu", "a.onnx") == ["CPUExecutionProvider"]
