from dataclasses import replace

import pytest

from core_solver.errors import UserError
from core_solver.evaluation import storage
from core_solver.evaluation.cases import FULL, Ablation, Case
from core_solver.evaluation.scores import MEASURES, Details, Measures, SceneScores
from core_solver.evaluation.storage import ScoreCache, make_directory

CASE = Case("fast", FULL)
SCORES = SceneScores(
    "yard",
    replace(Measures(*range(len(MEASURES))), depth_order=None),
    Details(*range(8)),
    ((1.5, None), (None, 2.0)),
)


@pytest.fixture
def cache(tmp_path):
    return ScoreCache(tmp_path / "cache", "tiny")


def test_scores_come_back_whole(cache):
    cache.write(3, CASE, SCORES)
    assert cache.read(3, "yard", CASE) == SCORES


def test_only_the_very_same_solve_is_taken_from_the_cache(cache, monkeypatch):
    cache.write(3, CASE, SCORES)
    assert cache.read(4, "yard", CASE) is None
    assert cache.read(3, "street", CASE) is None
    assert cache.read(3, "yard", Case("baseline", FULL)) is None
    assert cache.read(3, "yard", Case("fast", Ablation("depth", ("depth",)))) is None
    assert ScoreCache(cache.directory, "other motions").read(3, "yard", CASE) is None
    monkeypatch.setattr(storage, "program_hash", lambda: "another version")
    assert cache.read(3, "yard", CASE) is None


def test_a_change_of_settings_is_another_solve(cache, monkeypatch):
    from core_solver.optimise.presets import PRESETS

    cache.write(3, CASE, SCORES)
    fast = PRESETS["fast"]
    monkeypatch.setitem(PRESETS, "fast", replace(fast, weights=replace(fast.weights, depth_sigma=0.123)))
    assert cache.read(3, "yard", CASE) is None


def test_names_of_scenes_are_kept_for_each_seed(cache):
    cache.write_names(3, ["yard", "street"])
    assert cache.read_names(3) == ("yard", "street")
    assert cache.read_names(4) is None


def test_a_place_that_cannot_be_written_is_refused_at_once(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="choose another directory with -o"):
        make_directory(tmp_path / "file" / "results")
    make_directory(tmp_path / "new" / "results")
    assert list((tmp_path / "new" / "results").iterdir()) == []
