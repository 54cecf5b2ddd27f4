"""Declarations: what is read, and the words about what is wrong."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.errors import ModelError
from core_solver.perception.networks.kinds import KINDS, View
from core_solver.perception.networks.spec import NetworkSpec, parse_spec, read_spec
from tests.solver.perception.networks.graphs import declare

RTMPOSE = {
    "task": "pose", "decoder": "simcc", "input": [192, 256], "colour": "rgb", "keypoints": "halpe26",
    "mean": [123.675, 116.28, 103.53], "std": [58.395, 57.12, 57.375],
}  # fmt: skip


def test_a_few_lines_declare_a_network(tmp_path: Path) -> None:
    spec = read_spec(declare(tmp_path / "rtmpose.toml", **RTMPOSE))
    assert spec.file == tmp_path / "rtmpose.onnx"
    assert spec.input == (192, 256)
    assert spec.keypoints == "halpe26"
    assert spec.view is View.PERSON
    assert spec.std == (58.395, 57.12, 57.375)
    assert (spec.layout, spec.padding, spec.scale) == ("NCHW", 1.25, 1.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"colour": "grb"}, r"""'colour' is "grb": allowed are "rgb", "bgr"$"""),
        ({"task": "poses"}, r"""'task' is "poses": allowed are "pose", "masks", "depth", "smpl"$"""),
        ({"task": None}, "'task' is missing: allowed are"),
        ({"decoder": None}, r"""'decoder' is missing: allowed for the task "pose" are "heatmap", "simcc", """),
        ({"decoder": "yolo-seg"}, r"""'decoder' is "yolo-seg": allowed for the task "pose" are"""),
        ({"task": "depth"}, r"""'decoder' is "simcc": allowed for the task "depth" are "disparity","""),
        ({"colur": "rgb"}, r"""unknown key 'colur' for the decoder "simcc": allowed are task, decoder, colour"""),
        ({"udp": True}, r"""unknown key 'udp' for the decoder "simcc""" + '"'),
        ({"input": [192]}, r"'input' is \[192\]: allowed is \[width, height\] in pixels"),
        ({"input": [192.0, 256]}, r"'input' is .*: allowed is \[width, height\]"),
        ({"input": [True, 256]}, "'input' is"),
        ({"mean": [1, 2]}, r"'mean' is \[1, 2\]: allowed are three numbers, in the order of 'colour'"),
        ({"std": [1, 0, 1]}, "'std' is .*: allowed are three positive numbers"),
        ({"scale": "x"}, """'scale' is "x": allowed is a number from"""),
        ({"scale": True}, "'scale' is true: allowed is a number"),
        ({"layout": "CHW"}, r"""'layout' is "CHW": allowed are "NCHW", "NHWC"$"""),
        ({"keypoints": "coco"}, r"""'keypoints' is "coco": allowed are "coco17", "halpe26","""),
        ({"padding": 9}, "'padding' is 9: allowed is a number from 0.5 to 4$"),
        ({"outputs": {"z": "simcc_z"}}, r"unknown key 'outputs.z': allowed are x, y$"),
        ({"outputs": {"x": 3}}, "'outputs' is .*: allowed is a table"),
        ({"file": ""}, "'file' is"),
    ],
)  # fmt: skip
def test_wrong_keys_are_named_with_what_is_allowed(tmp_path: Path, change: dict, words: str) -> None:
    keys = {key: value for key, value in {**RTMPOSE, **change}.items() if value is not None}
    with pytest.raises(ModelError, match=words) as caught:
        read_spec(declare(tmp_path / "mine.toml", **keys))
    assert str(caught.value).startswith("mine.toml: ")
    assert "\n" not in str(caught.value)


def test_files_that_declare_nothing(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    with pytest.raises(ModelError, match=r"no network declaration .*mine.toml"):
        read_spec(path)
    path.write_text("[network\n")
    with pytest.raises(ModelError, match="is no TOML"):
        read_spec(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ModelError, match="is no TOML"):
        read_spec(path)
    path.write_text('task = "pose"\n')
    with pytest.raises(ModelError, match=r"unknown table \[task\]"):
        read_spec(path)
    path.write_text("[about]\n")
    with pytest.raises(ModelError, match=r"table \[network\] is missing"):
        read_spec(path)
    path.write_text('[network]\ntask = "depth"\ndecoder = "disparity"\n')
    with pytest.raises(ModelError, match="'file' is missing"):
        read_spec(path)
    path.write_text('[network]\ntask = "depth"\ndecoder = "disparity"\nfile = "a.onnx"\n[about]\nowner = "me"\n')
    with pytest.raises(ModelError, match=r"\[about\] may hold project, page, licence"):
        read_spec(path)


def test_a_regressor_of_whole_pictures_must_say_where_people_are(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="'camera' is missing"):
        read_spec(declare(tmp_path / "romp.toml", task="smpl", decoder="smpl", sees="picture", input=[512, 512]))


def test_every_decoder_can_be_declared(tmp_path: Path) -> None:
    for name, kind in KINDS.items():
        spec = read_spec(declare(tmp_path / f"{name}.toml", task=kind.task, decoder=name))
        assert spec.kind is kind


KEYS = [*sorted(NetworkSpec.__dataclass_fields__), "task", "nonsense"]
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.sampled_from(["pose", "simcc"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


@given(st.dictionaries(st.sampled_from(KEYS), VALUES, max_size=5), st.none() | VALUES, st.booleans())
def test_whatever_stands_there_gives_a_declaration_or_one_line(network: dict, about: object, sound: bool) -> None:
    table = {"network": {**(RTMPOSE | {"file": "a.onnx"} if sound else {}), **network}}
    if about is not None:
        table["about"] = about  # type: ignore[assignment]
    spec, words = None, ""
    try:
        spec = parse_spec(table, Path("mine.toml"))
    except ModelError as error:
        words = str(error)
    if spec is None:
        assert words.startswith("mine.toml: ")
    else:
        assert len(spec.mean) == len(spec.std) == 3
        assert isinstance(spec.about.commercial, bool)
