"""The examples of docs/modalities.md, written and read as they stand there."""

import re
from pathlib import Path

import pytest

from core_solver.perception.precomputed.folder import open_folder
from core_solver.perception.precomputed.given import open_modalities
from core_solver.video import open_video
from tests.conftest import REPO_ROOT
from tests.solver.body.synthetic import make_stick_body
from tests.solver.perception.precomputed.export import draw_video

TEXT = (REPO_ROOT / "docs" / "modalities.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
SETTINGS = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return draw_video(tmp_path_factory.mktemp("video") / "clip.avi", frames=14, size=(640, 480))


def test_there_is_one_for_each_reader() -> None:
    assert len(EXAMPLES) == 11
    assert len(SETTINGS) == 1


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda text: "-".join(re.findall(r"\"([a-z]+)[/.\"]", text)[:1]))
def test_an_example_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, video: Path, example: str) -> None:
    monkeypatch.chdir(tmp_path)
    exec(example, {})  # noqa: S102 - our own documentation
    given = open_modalities(tmp_path, open_video(video), make_stick_body())
    assert len(given.folder.sources()) == 1
    if given.joints is not None:
        (person,) = given.joints.people[12]
        assert tuple(person.keypoints[0]) == (320, 120)
    elif given.smpl is not None:
        assert len(given.smpl[12]) == 2
    elif given.masks is not None:
        (mask,) = given.masks_at(12)
        assert mask.identity == 1
        assert mask.values[100:400, 200:300].all()
        assert not mask.values[:, :200].any()
        assert not mask.values[:, 300:].any()
    else:
        plane = given.disparity_at(12)
        assert plane is not None
        assert plane[0, 0] > 0.99, "near is large"
        assert plane[-1, -1] < 0.01


def test_the_settings_are_understood(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "alphapose-results.json").write_text("[]")
    (tmp_path / "modalities.toml").write_text(SETTINGS[0])
    joints = open_folder(tmp_path).joints
    assert joints is not None
    assert (joints.first, joints.size, joints.identities) == (1, (1280, 720), False)
