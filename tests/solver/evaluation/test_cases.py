import numpy as np
import pytest

from core_solver.energy.weights import Weights
from core_solver.errors import UserError
from core_solver.evaluation import cases
from core_solver.evaluation.cases import FULL, Ablation, Case, choose_cases
from core_solver.optimise.presets import PRESETS


def test_the_standard_suite_compares_whole_presets_with_the_baseline_first():
    chosen = choose_cases("standard", None)
    assert chosen[0] == Case("baseline", FULL)
    assert {case.preset for case in chosen} == {"baseline", *PRESETS} & {"baseline", "paper", "exact", "fast"}
    assert all(case.ablation is FULL for case in chosen)


def test_the_ablation_suite_leaves_one_part_out_at_a_time():
    chosen = choose_cases("ablation", ["fast"])
    assert chosen[0] == Case("fast", FULL)
    names = [case.ablation.name for case in chosen]
    assert {"none", "depth", "height", "smpl", "speed", "contact and slip", "temporal", "acceleration"} <= set(names)
    assert len(names) == len(set(names))
    whole = PRESETS["fast"].weights
    for case in chosen:
        settings = case.settings()
        assert settings is not None
        off = {term for term in Weights.terms() if getattr(settings.weights, term) != getattr(whole, term)}
        assert off <= set(case.ablation.terms)
        assert all(getattr(settings.weights, term) == 0 for term in case.ablation.known_terms())


def test_the_papers_tables_have_the_papers_rows():
    stage_one = [ablation.name for ablation in cases.PAPER_STAGE_ONE_TABLE]
    assert stage_one == ["depth", "scale", "smpl", "speed", "silhouette", "none"]
    off = [set(ablation.terms) & {"contact", "slip", "temporal"} for ablation in cases.PAPER_STAGE_TWO_TABLE]
    assert off == [{"contact", "slip", "temporal"}, {"slip", "temporal"}, {"temporal"}, {"contact", "slip"}, set()]


def test_terms_that_do_not_exist_are_passed_over(monkeypatch):
    future = (FULL, Ablation("hopes", ("hopes",)), Ablation("mixed", ("hopes", "depth")))
    monkeypatch.setitem(cases.ABLATIONS, "fast", future)
    chosen = choose_cases("ablation", ["fast"])
    assert [case.ablation.name for case in chosen] == ["none", "mixed"]
    assert chosen[1].ablation.known_terms() == ("depth",)


def test_presets_are_taken_once_and_in_the_order_given():
    assert choose_cases("stress", ["fast", "baseline", "fast"]) == (Case("fast", FULL), Case("baseline", FULL))


def test_the_baseline_has_nothing_to_leave_out():
    assert choose_cases("ablation", ["baseline"]) == (Case("baseline", FULL),)


def test_an_unknown_preset_is_refused_with_the_known_ones():
    with pytest.raises(UserError, match=r"called slow: choose from baseline, .*fast"):
        choose_cases("standard", ["fast", "slow"])


def test_settings_tell_cases_apart():
    depth, none = Case("fast", Ablation("depth", ("depth",))), Case("fast", FULL)
    assert repr(depth.settings()) != repr(none.settings())
    assert np.isclose(none.settings().weights.depth, PRESETS["fast"].weights.depth)
