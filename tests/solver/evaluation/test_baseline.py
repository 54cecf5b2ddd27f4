from dataclasses import replace

import numpy as np
import pytest

from core_solver.evaluation.baseline import baseline
from core_solver.evaluation.scores import pose_people
from tests.solver.evaluation.fakes import make_fake


@pytest.fixture(scope="module")
def fake():
    return make_fake()


def solve(scene):
    return baseline(scene.modalities, scene.camera, scene.body)


def test_an_average_adult_is_placed_well_and_a_smaller_person_too_far_away(fake):
    solution = solve(fake.scene)
    roots, truth = pose_people(solution, fake.scene.body).joints[:, :, 0], fake.scene.truth.joints[:, :, 0]
    adult, small = np.linalg.norm(roots - truth, axis=-1).mean(axis=1)
    assert adult < 0.3
    # Seen at unit scale, somebody 0.85 times as tall seems 1 / 0.85 times as far away.
    assert roots[1, :, 2].mean() == pytest.approx(truth[1, :, 2].mean() / 0.85, rel=0.05)
    assert small > 0.5
    np.testing.assert_array_equal(solution.scales, 1)


def test_frames_know_nothing_of_each_other(fake):
    whole = solve(fake.scene)
    tracks = fake.scene.modalities.tracks
    other = tracks[0].keypoints.copy()
    other[3] += 40
    changed = replace(tracks[0], keypoints=other)
    again = solve(replace(fake.scene, modalities=replace(fake.scene.modalities, tracks=(changed, tracks[1]))))
    same = np.arange(12) != 3
    np.testing.assert_allclose(again.gamma[0, same], whole.gamma[0, same], atol=1e-9)
    assert np.abs(again.gamma[0, 3] - whole.gamma[0, 3]).max() > 0.05


def test_frames_without_evidence_lie_on_the_line_between_their_neighbours(fake):
    tracks = fake.scene.modalities.tracks
    valid = np.ones(12, bool)
    valid[5] = False
    gap = replace(tracks[0], valid=valid, confidence=np.where(valid[:, None], tracks[0].confidence, 0))
    solution = solve(replace(fake.scene, modalities=replace(fake.scene.modalities, tracks=(gap, tracks[1]))))
    np.testing.assert_allclose(solution.gamma[0, 5], (solution.gamma[0, 4] + solution.gamma[0, 6]) / 2)


def test_somebody_never_seen_stands_in_front_of_the_camera(fake):
    tracks = fake.scene.modalities.tracks
    nobody = replace(tracks[0], valid=np.zeros(12, bool), confidence=0 * tracks[0].confidence)
    solution = solve(replace(fake.scene, modalities=replace(fake.scene.modalities, tracks=(nobody, tracks[1]))))
    assert np.isfinite(solution.gamma).all()
    assert (solution.gamma[0, :, 2] > 0).all()


def test_it_claims_no_contacts(fake):
    assert not solve(fake.scene).contacts.any()
