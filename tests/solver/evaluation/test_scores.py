from dataclasses import replace

import numpy as np
import pytest

from core_solver.evaluation.scores import MEASURES, Measures, evaluate_scene, mean_row
from tests.solver.evaluation.fakes import make_fake


@pytest.fixture(scope="module")
def fake():
    return make_fake()


def score(fake, **changes):
    return evaluate_scene(fake.scene, replace(fake.solution, **changes), seconds=3.0, peak_mb=400.0)


def test_the_truth_itself_is_without_fault(fake):
    scores = score(fake)
    m = scores.measures
    for name in ("mrpe_mm", "mpjpe_mm", "pa_mpjpe_mm", "jitter_paper_mm", "height_error", "group_w_mm"):
        assert getattr(m, name) == pytest.approx(0, abs=1e-6)
    for name in ("ap25", "ap25_matched", "pck3d", "contact_f1", "depth_order"):
        assert getattr(m, name) == 1
    assert m.penetration_mm == 0
    assert (m.seconds, m.peak_mb) == (3.0, 400.0)
    assert m.jitter_wham == pytest.approx(scores.details.true_jitter_wham)


def test_a_wrong_place_shows_in_place_alone(fake):
    m = score(fake, gamma=fake.solution.gamma + np.array([0, 0, 0.5])).measures
    assert m.mrpe_mm == pytest.approx(500)
    assert m.ap25 == m.ap25_matched == 0
    assert m.mpjpe_mm == pytest.approx(0, abs=1e-6)
    assert m.group_w_mm == pytest.approx(0, abs=1e-6)
    assert m.penetration_mm > 0  # the floor rises towards the horizon, so who stands too far stands in it


def test_a_world_that_is_too_large_shows_in_heights_and_vanishes_only_where_scale_is_fitted(fake):
    large = score(fake, gamma=1.3 * fake.solution.gamma, scales=1.3 * fake.solution.scales)
    assert large.measures.height_error == pytest.approx(0.3)
    assert large.measures.mrpe_mm > 1000
    assert large.measures.group_w_mm > 100
    assert large.measures.pa_mpjpe_mm == pytest.approx(0, abs=1e-6)
    assert large.details.group_w_scaled_mm == pytest.approx(0, abs=1e-6)
    assert large.details.w_mpjpe_scaled_mm < 1 < large.details.w_mpjpe_mm
    assert large.details.wa_mpjpe_scaled_mm < 1 < large.details.wa_mpjpe_mm


def test_what_happens_while_truth_is_absent_does_not_matter(fake):
    present = np.ones((2, 12), bool)
    present[1, 4:8] = False
    scene = replace(fake.scene, truth=replace(fake.scene.truth, present=present))
    gamma = fake.solution.gamma.copy()
    gamma[1, 4:8] += 100
    scores = evaluate_scene(scene, replace(fake.solution, gamma=gamma), 1.0, 1.0)
    assert scores.measures.mrpe_mm == pytest.approx(0, abs=1e-6)
    assert scores.measures.ap25 == 1
    assert scores.root_errors_mm[1][3:9] == (0.0, None, None, None, None, 0.0)


def test_who_was_not_seen_yet_costs_average_precision_only(fake):
    tracks = fake.scene.modalities.tracks
    valid = np.ones(12, bool)
    valid[:6] = False
    valid[8] = False  # a gap between sights is filled and counts
    late = replace(tracks[1], valid=valid)
    modalities = replace(fake.scene.modalities, tracks=(tracks[0], late))
    gamma = fake.solution.gamma.copy()
    gamma[1, :6] += 100
    gamma[1, 8] += (0, 0, 0.7)
    scores = evaluate_scene(replace(fake.scene, modalities=modalities), replace(fake.solution, gamma=gamma), 1.0, 1.0)
    assert scores.measures.mrpe_mm == pytest.approx(700 / 18)
    assert scores.measures.ap25_matched == pytest.approx(17 / 18)
    assert scores.measures.ap25 == pytest.approx(17 / 24, rel=0.02)


def test_one_person_alone_has_no_order_in_depth(fake):
    truth, modalities = fake.scene.truth, fake.scene.modalities
    alone = replace(
        fake.scene,
        modalities=replace(modalities, tracks=modalities.tracks[:1]),
        truth=replace(
            truth,
            **{name: getattr(truth, name)[:1] for name in ("joints", "soles", "present", "contacts", "heights")},
        ),
    )
    names = ("theta", "gamma", "betas", "scales", "confidence", "contacts")
    one = replace(fake.solution, **{name: getattr(fake.solution, name)[:1] for name in names})
    scores = evaluate_scene(alone, one, 1.0, 1.0)
    assert scores.measures.depth_order is None
    assert scores.measures.mrpe_mm == pytest.approx(0, abs=1e-6)


def test_a_row_is_the_mean_of_the_scenes_that_have_a_number(fake):
    first = score(fake)
    second = replace(first, measures=replace(first.measures, mrpe_mm=300.0, depth_order=None))
    row = mean_row("fast", "none", (0, 1), [first, second])
    assert row.measures.mrpe_mm == pytest.approx(150)
    assert row.measures.depth_order == 1
    empty = replace(first, measures=Measures(**dict.fromkeys(MEASURES)))
    assert mean_row("fast", "none", (0,), [empty]).measures.mrpe_mm is None


def test_a_row_has_exactly_the_promised_keys(fake):
    assert list(mean_row("fast", "depth", (0, 3), [score(fake)]).as_json()) == [
        "preset", "ablation", "seeds", "mrpe_mm", "ap25_matched", "ap25", "pck3d", "mpjpe_mm", "pa_mpjpe_mm",
        "jitter_paper_mm", "jitter_wham", "skate_mm", "penetration_mm", "contact_f1", "height_error", "group_w_mm",
        "depth_order", "seconds", "peak_mb",
    ]  # fmt: skip
