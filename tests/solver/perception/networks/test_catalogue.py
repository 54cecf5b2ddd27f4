"""The catalogue: every entry is well formed, tells its source and licence, and is found by name."""

from pathlib import Path

import pytest

from core_solver.errors import ModelError
from core_solver.perception.models_cli import list_networks
from core_solver.perception.networks.catalogue import known_networks, read_declaration
from core_solver.perception.networks.kinds import TASKS
from core_solver.perception.store import ModelStore, catalogue
from tests.solver.perception.networks.graphs import declare

BY_NAME = {spec.toml.stem: spec for spec in known_networks()}


@pytest.mark.parametrize("name", sorted(BY_NAME))
def test_entries_tell_where_they_come_from(name: str) -> None:
    spec = BY_NAME[name]
    assert spec.file.name == f"{name}.onnx"
    assert spec.about.page.startswith("https://")
    assert all((spec.about.project, spec.about.licence, spec.about.export))
    restricted = any(word in spec.about.licence for word in ("NC", "research"))
    assert spec.about.commercial is not restricted
    if not spec.about.commercial:
        assert any(word in spec.toml.read_text().splitlines()[0] for word in ("commercial", "research"))


@pytest.mark.parametrize("name", sorted(BY_NAME))
def test_the_documentation_says_the_same_and_how_it_was_checked(name: str, repo_root: Path) -> None:
    text = (repo_root / "docs" / "networks.md").read_text(encoding="utf-8")
    (row,) = (line for line in text.splitlines() if line.startswith(f"| `{name}` |"))
    _, _, licence, data, checked, _ = (cell.strip() for cell in row.split("|"))
    assert (licence, data) == (BY_NAME[name].about.licence, BY_NAME[name].about.data)
    assert any(word in checked for word in ("licence file", "readme", "not checked", "as "))


def test_weights_with_restricted_origins_say_so() -> None:
    """A repository's licence is not that of its weights, nor are these freer than what they were made from."""
    assert not BY_NAME["mask2former-swin-tiny"].about.commercial
    assert "COCO-WholeBody" in BY_NAME["rtmw-l"].about.data
    assert "MAE" in BY_NAME["vitpose-base"].about.data


def test_every_task_has_entries() -> None:
    assert {spec.kind.task for spec in BY_NAME.values()} == set(TASKS)
    assert not any(entry.task == "networks" and entry.default for entry in catalogue()[1])


def test_an_entry_takes_its_network_from_the_store(tmp_path: Path) -> None:
    store = ModelStore(tmp_path / "models")
    with pytest.raises(
        ModelError, match=r"rtmpose-m.onnx is not here: get it from https://github.com/open-mmlab/.* --name rtmpose-m'$"
    ):
        read_declaration("rtmpose-m", store)
    downloaded = tmp_path / "end2end.onnx"
    downloaded.write_bytes(b"a network")
    added = store.add(downloaded, "rtmpose-m", "networks")
    spec = read_declaration("rtmpose-m", store)
    assert spec.file == added
    assert spec.keypoints == "coco17"


def test_what_the_store_can_fetch_is_fetched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store, fetched = ModelStore(tmp_path), []
    monkeypatch.setattr(store, "fetch", lambda name: fetched.append(name) or tmp_path / "fetched.onnx")
    assert read_declaration("midas-v2.1-small", store).file == tmp_path / "fetched.onnx"
    assert fetched == ["midas-v2.1-small"]


def test_a_file_goes_before_nothing_else(tmp_path: Path) -> None:
    toml = declare(tmp_path / "mine.toml", task="depth", decoder="disparity")
    assert read_declaration(toml, ModelStore(tmp_path)).file == tmp_path / "mine.onnx"
    assert read_declaration(str(toml), ModelStore(tmp_path)).toml == toml
    with pytest.raises(ModelError, match=r"no network declaration yours.toml: give a TOML file, or one of depth-"):
        read_declaration("yours.toml", ModelStore(tmp_path))


def test_the_list_names_licences_and_what_is_here(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store = ModelStore(tmp_path)
    (tmp_path / "networks").mkdir()
    (tmp_path / "networks" / "rtmo-m.onnx").write_bytes(b"a network")
    list_networks(store)
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line.startswith("  ")}
    assert set(lines) == set(BY_NAME)
    assert " here " in lines["rtmo-m"]
    assert " to be added " in lines["vitpose-base"]
    assert " on request " in lines["midas-v2.1-small"]
    assert "https://github.com/ViTAE-Transformer/ViTPose" in lines["vitpose-base"]
    assert "not commercial" in lines["depth-anything-v2-large"]
    assert "not commercial" not in lines["depth-anything-v2-small"]
    assert "Apache-2.0 (trained on COCO-WholeBody" in lines["rtmw-l"]
