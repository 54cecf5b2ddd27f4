import pytest

from core_solver.energy.paper import PaperWeights
from core_solver.energy.weights import Weights
from core_solver.errors import UserError
from core_solver.evaluation import cases
from core_solver.evaluation.cases import FULL, OWN_TABLE, Ablation, Case, choose_cases
from core_solver.optimise.presets import PRESETS

OWN = {ablation.name: ablation for ablation in OWN_TABLE}


def off(case: Case) -> set[str]:
    """Terms that count in the whole preset and not in this case; all others must count the same."""
    whole, weights = PRESETS[case.preset].weights, case.settings().weights
    changed = {name for name in vars(whole) if getattr(weights, name) != getattr(whole, name)}
    assert all(getattr(weights, name) == 0 for name in changed)
    return changed


def test_the_standard_suite_compares_whole_presets_with_the_baseline_first():
    chosen = choose_cases("standard", None)
    assert chosen == tuple(Case(name, FULL) for name in ("baseline", "paper", "exact", "fast"))


def test_the_ablation_suite_studies_ours_and_the_papers():
    assert {case.preset for case in choose_cases("ablation", None)} == {"fast", "paper"}


@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_the_ablation_suite_has_the_whole_preset_and_leaves_parts_out(preset):
    chosen = choose_cases("ablation", [preset])
    assert [case for case in chosen if not off(case)] == [Case(preset, FULL)]
    for case in chosen:
        assert off(case) == set(case.left_out) <= set(case.ablation.terms)


@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_no_two_rows_of_a_preset_solve_the_same(preset):
    chosen = choose_cases("ablation", [preset])
    assert len({case.label for case in chosen}) == len({frozenset(off(case)) for case in chosen}) == len(chosen)


@pytest.mark.parametrize(
    ("preset", "part", "terms"),
    [
        ("fast", "smpl", {"smpl", "betas"}),
        ("exact", "smpl", {"smpl", "betas"}),
        ("paper", "smpl", {"smpl"}),  # shape is part of its E_smpl
        ("fast", "height", {"height"}),
        ("paper", "height", {"scale"}),
        ("fast", "contact and slip", {"contact", "slip", "penetration"}),
        ("paper", "contact and slip", {"contact", "slip"}),
        ("paper", "acceleration", set()),
        ("baseline", "depth", set()),
    ],
)
def test_each_preset_loses_the_terms_that_it_has(preset, part, terms):
    assert set(Case(preset, OWN[part]).left_out) == terms


def test_every_term_of_a_table_belongs_to_some_preset():
    known = {*Weights.terms(), *PaperWeights.terms()}
    tables = (*cases.OWN_TABLE, *cases.PAPER_STAGE_ONE_TABLE, *cases.PAPER_STAGE_TWO_TABLE)
    assert {term for ablation in tables for term in ablation.terms} <= known


def test_the_papers_tables_have_the_papers_rows():
    stage_one = [ablation.name for ablation in cases.PAPER_STAGE_ONE_TABLE]
    assert stage_one == ["depth", "scale", "smpl", "speed", "silhouette", "none"]
    left_out = [set(ablation.known_terms("paper")) for ablation in cases.PAPER_STAGE_TWO_TABLE]
    assert left_out == [{"contact", "slip", "temporal"}, {"slip", "temporal"}, {"temporal"}, {"contact", "slip"}, set()]


def test_terms_that_do_not_exist_are_passed_over(monkeypatch):
    future = (FULL, Ablation("hopes", ("hopes",)), Ablation("mixed", ("hopes", "depth")))
    monkeypatch.setitem(cases.ABLATIONS, "fast", future)
    chosen = choose_cases("ablation", ["fast"])
    assert [case.ablation.name for case in chosen] == ["none", "mixed"]
    assert chosen[1].left_out == ("depth",)


def test_presets_are_taken_once_and_in_the_order_given():
    assert choose_cases("stress", ["fast", "baseline", "fast"]) == (Case("fast", FULL), Case("baseline", FULL))


def test_the_baseline_has_nothing_to_leave_out():
    assert choose_cases("ablation", ["baseline"]) == (Case("baseline", FULL),)
    assert Case("baseline", FULL).settings() is None


def test_an_unknown_preset_is_refused_with_the_known_ones():
    with pytest.raises(UserError, match=r"called slow: choose from baseline, .*fast"):
        choose_cases("standard", ["fast", "slow"])


def test_settings_tell_cases_apart():
    depth = Case("fast", Ablation("depth", ("depth",)))
    assert repr(depth.settings()) != repr(Case("fast", FULL).settings())
