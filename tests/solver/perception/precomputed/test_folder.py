"""What is found in a folder, and what modalities.toml may say."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from core_solver.errors import UserError
from core_solver.perception.precomputed.folder import open_folder
from tests.solver.perception.precomputed.damage import damaged, value_or_user_error


def put(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("x")
    return path


def test_the_projects_own_names(tmp_path: Path) -> None:
    files = [
        put(tmp_path / name) for name in ("joints/a.json", "smpl/1.npz", "depth/1.exr", "masks/1.png", "notes.txt")
    ]
    folder = open_folder(tmp_path)
    assert [s.label for s in folder.sources()] == ["joints", "smpl", "depth", "masks"]
    assert folder.depth is not None
    assert folder.depth.is_metric
    assert set(folder.files()) == set(files[:4])


def test_the_authors_names_in_any_case(tmp_path: Path) -> None:
    for name in ("AlphaPose/alphapose-results.json", "ROMP_Predictions/img_1.npz", "dpt_large_monodepth/img_1.png",
                 "Mask2Former_Instances/img_1.png", "images/img_1.jpg"):  # fmt: skip
        put(tmp_path / name)
    folder = open_folder(tmp_path)
    assert folder.joints is not None
    assert folder.depth is not None
    assert folder.masks is not None
    assert folder.smpl is not None
    assert not folder.depth.is_metric
    assert not folder.masks.identities
    assert folder.joints.identities


def test_a_part_is_enough_and_empty_folders_do_not_count(tmp_path: Path) -> None:
    put(tmp_path / "disparity" / "1.png")
    (tmp_path / "depth").mkdir()
    folder = open_folder(tmp_path)
    assert folder.depth is not None
    assert folder.depth.label == "disparity"
    assert (folder.joints, folder.smpl, folder.masks) == (None, None, None)


def test_wishes(tmp_path: Path) -> None:
    put(tmp_path / "far" / "away.npz")
    (tmp_path / "modalities.toml").write_text(
        '[depth]\npath = "far/away.npz"\nkind = "depth"\nfirst = 3\nsize = [64, 48]\nstretch = true\n'
    )
    folder = open_folder(tmp_path)
    assert folder.depth is not None
    assert (folder.depth.label, folder.depth.first, folder.depth.size) == ("far/away.npz", 3, (64, 48))
    assert (folder.depth.is_metric, folder.depth.stretch) == (True, True)
    assert tmp_path / "modalities.toml" in folder.files()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[depth\n", "cannot be read"),
        ("[dept]\n", "dept is not known"),
        ('[depth]\nunit = "mm"\n', "unit is not known"),
        ("depth = 3\n", "depth is not known"),
        ('[depth]\npath = "nowhere"\n', r"there is no .*nowhere: mend path of \[depth\]"),
        ('[joints]\nfirst = "1"\n', r"first of \[joints\] must be a whole number"),
        ("[joints]\nfirst = true\n", r"first of \[joints\] must be a whole number"),
        ('[depth]\nkind = "inverse"\n', r'kind of \[depth\] must be "disparity" or "depth"'),
        ("[depth]\nsize = [3]\n", r"size of \[depth\] must be \[width, height\]"),
    ],
)
def test_wishes_that_mean_nothing_are_refused(tmp_path: Path, text: str, complaint: str) -> None:
    put(tmp_path / "depth" / "1.png")
    put(tmp_path / "joints" / "1.json")
    (tmp_path / "modalities.toml").write_text(text)
    with pytest.raises(UserError, match=complaint):
        open_folder(tmp_path)


def test_nothing_twice_and_nowhere_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no folder of modalities"):
        open_folder(tmp_path / "nowhere")
    with pytest.raises(UserError, match="holds no modality"):
        open_folder(tmp_path)
    put(tmp_path / "depth" / "1.png")
    put(tmp_path / "DPT_large_monodepth" / "1.png")
    with pytest.raises(UserError, match=r"holds depth twice, depth and DPT_large_monodepth: name one"):
        open_folder(tmp_path)
    (tmp_path / "modalities.toml").write_text('[depth]\npath = "depth"\n')
    assert open_folder(tmp_path).depth is not None


@given(damaged(b'[depth]\npath = "depth"\nkind = "depth"\nfirst = 3\nsize = [64, 48]\n') | st.text().map(str.encode))
@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_settings_of_any_form_give_a_line_or_a_folder(tmp_path: Path, content: bytes) -> None:
    put(tmp_path / "depth" / "1.png")
    value_or_user_error(tmp_path / "modalities.toml", content, lambda file: open_folder(file.parent))
