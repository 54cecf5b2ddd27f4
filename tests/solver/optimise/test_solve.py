from dataclasses import replace

import numpy as np
import pytest

from core_solver.camera import Camera
from core_solver.energy.weights import Weights
from core_solver.optimise import pose_fit
from core_solver.optimise.presets import PRESETS
from core_solver.optimise.solve import Solution, solve
from core_solver.progress import SilentProgress
from core_solver.tracking.tracks import Modalities
from tests.solver.optimise.conftest import GAP, LATE
from tests.solver.optimise.measures import all_finite, jitter, mpjpe, solved_joints, solved_vertices
from tests.solver.scenes import SyntheticClip, Walker, change_tracks, make_clip

PORTRAIT = Camera(540, 960, 900.0, 760.0, 265.0, 485.0, (-0.1, 0.02, 0.001, 0.0, 0.0), "truth")


@pytest.fixture
def quick(monkeypatch):
    """Few steps, for questions that more steps do not answer."""
    monkeypatch.setattr(pose_fit, "ITERATIONS", 10)


def run(modalities: Modalities, clip: SyntheticClip, body) -> Solution:
    return solve(modalities, clip.camera, body, SilentProgress(), PRESETS["fast"])


def valid_frames(clip: SyntheticClip) -> np.ndarray:
    return np.stack([track.valid for track in clip.modalities.tracks])


# --- The couple: two sizes, a late entrant, a gap, against the truth ------------------------------------------------


def test_poses_are_right(couple, couple_solved, body):
    error = mpjpe(solved_joints(couple_solved, body), couple, couple_solved.scales)
    assert error[valid_frames(couple)].mean() < 0.025
    assert error.max() < 0.08


def test_the_smaller_one_is_smaller_and_not_farther(couple, couple_solved, body):
    ratio = couple_solved.scales[1] / couple_solved.scales[0]
    assert ratio == pytest.approx(0.85, rel=0.07)
    # Where they stand against each other, by the world's own size.
    roots = solved_joints(couple_solved, body)[:, :, 0] / couple_solved.ground.offset
    truth = couple.joints[:, :, 0] / couple.camera_height
    apart, true_apart = roots[1] - roots[0], truth[1] - truth[0]
    assert np.linalg.norm(apart - true_apart, axis=-1).mean() < 0.15 * np.linalg.norm(true_apart, axis=-1).mean()


def test_the_ground_has_its_tilt_and_points_up(couple, couple_solved):
    ground = couple_solved.ground
    assert np.linalg.norm(ground.normal) == pytest.approx(1)
    assert np.degrees(np.arccos(ground.normal @ couple.up)) < 3
    assert ground.gravity @ ground.normal < -0.99
    # The camera's height follows the people's, whose mean is a prior.
    scale = np.exp(np.log(couple_solved.scales / couple.scales).mean())
    assert ground.offset / scale == pytest.approx(couple.camera_height, rel=0.05)


def test_feet_in_contact_stand_on_the_ground(couple, couple_solved, body):
    heights = couple_solved.ground.height_above(solved_vertices(couple_solved, body)).min(axis=-1)
    standing = couple_solved.contacts.max(axis=-1) > 0.5
    assert standing[valid_frames(couple)].mean() > 0.6
    assert np.abs(heights[standing]).mean() < 0.04
    assert np.abs(heights[standing]).max() < 0.08


def test_feet_in_contact_rest(couple, couple_solved, body):
    """Slip is measured at the truth's resting foot, in truth's own time of contact."""
    vertices = couple.vertices
    heights = vertices @ couple.up + couple.camera_height
    lowest = heights.argmin(axis=-1)
    found = solved_vertices(couple_solved, body)
    slips = [
        np.linalg.norm(found[n, t + 1, lowest[n, t]] - found[n, t, lowest[n, t]])
        for n in range(2)
        for t in range(35)
        if valid_frames(couple)[n, t : t + 2].all()
    ]
    assert np.mean(slips) < 0.02


def test_motion_is_no_more_nervous_than_the_truth(couple, couple_solved, body):
    assert jitter(solved_joints(couple_solved, body)) < jitter(couple.joints)


def test_frames_without_evidence_are_filled_without_a_jump(couple, couple_solved, body):
    joints = solved_joints(couple_solved, body)
    steps = np.linalg.norm(np.diff(joints, axis=1), axis=-1).max(axis=-1)
    fastest = np.linalg.norm(np.diff(couple.joints, axis=1), axis=-1).max()
    assert steps[0, GAP.start - 1 : GAP.stop].max() < fastest
    assert steps[1, : LATE + 1].max() < fastest
    # A walker hidden for 0.4 s is found again on the way.
    error = joints[0, :, 0] / couple_solved.ground.offset - couple.joints[0, :, 0] / couple.camera_height
    astray = np.linalg.norm(error - np.median(error[valid_frames(couple)[0]], axis=0), axis=-1)
    assert astray[GAP].max() < 0.12


def test_frames_without_evidence_claim_neither_confidence_nor_contact(couple, couple_solved):
    hidden = ~valid_frames(couple)
    assert (couple_solved.confidence[hidden] == 0).all()
    assert (couple_solved.confidence[~hidden] > 0.5).all()
    assert (couple_solved.contacts[hidden] == 0).all()


def test_the_depth_range_is_ordered_and_steady(couple_solved):
    near = 1 / (couple_solved.inverse_far + couple_solved.inverse_gap)
    far = 1 / couple_solved.inverse_far
    assert (near > 0).all()
    assert (near < far).all()
    assert np.ptp(np.log(near)) < 0.1


# --- Unusual clips ----------------------------------------------------------------------------------------------------


def test_portrait_uneven_focal_lengths_and_distortion(body):
    clip = make_clip(body, [Walker(1.0, (-0.3, 5), 0.5), Walker(0.95, (0.6, 7), -1.0)], frames=20, camera=PORTRAIT)
    solution = run(clip.modalities, clip, body)
    joints = solved_joints(solution, body)
    assert mpjpe(joints, clip, solution.scales).mean() < 0.035
    pixels = PORTRAIT.project(joints[:, :, [7, 8]])
    assert np.abs(pixels - PORTRAIT.project(clip.joints[:, :, [7, 8]])).mean() < 4
    assert np.degrees(np.arccos(solution.ground.normal @ clip.up)) < 5


def test_far_and_near_people_both_get_their_place(body):
    """From 3 m to 30 m: the start is closed-form, so that no distance is out of reach."""
    clip = make_clip(body, [Walker(1.0, (-0.7, 3.5), 0.5), Walker(1.0, (3, 30), -1.0)], frames=16, tilt=0.1)
    solution = run(clip.modalities, clip, body)
    depth = solved_joints(solution, body)[:, :, 0, 2].mean(axis=1)
    truth = clip.joints[:, :, 0, 2].mean(axis=1)
    assert depth[1] / depth[0] == pytest.approx(truth[1] / truth[0], rel=0.12)


def test_somebody_who_stands_still_stands_still(body):
    clip = make_clip(body, [Walker(1.0, (0, 5), 0.5, is_still=True)], frames=20)
    solution = run(clip.modalities, clip, body)
    joints = solved_joints(solution, body)
    assert np.linalg.norm(np.diff(joints, axis=1), axis=-1).mean() < 0.005
    assert np.linalg.norm(joints[:, -1, 0] - joints[:, 0, 0], axis=-1).max() < 0.1
    assert (solution.contacts > 0.5).mean() > 0.9


def test_a_raised_foot_is_not_in_contact_however_still_it_is(quick, body):
    clip = make_clip(body, [Walker(1.0, (0, 5), 0.5, is_still=True, on_one_leg=True)], frames=10)
    contacts = run(clip.modalities, clip, body).contacts[0]
    assert contacts[:, 0].max() < 0.1
    assert contacts[:, 1].min() > 0.8


def test_one_person_alone_is_of_average_height(body):
    clip = make_clip(body, [Walker(0.8, (0, 5), 0.5)], frames=12)
    solution = run(clip.modalities, clip, body)
    height = solution.scales[0] * body.height(solution.betas[0])
    assert height == pytest.approx(Weights().height_mean_m, rel=0.05)


def test_half_a_body_below_the_border(body):
    """Only from the hips up: the place must come from what is seen."""
    clip = make_clip(body, [Walker(1.0, (-1, 5), 0.5), Walker(1.0, (0.5, 6), -1.0)], frames=12)

    def cut(track):
        if track.id != 2:
            return track
        confidence = track.confidence.copy()
        confidence[:, 13:21] = 0
        keypoints = track.keypoints.copy()
        keypoints[:, 13:21] += (0, 400)
        return replace(track, confidence=confidence, keypoints=keypoints)

    solution = run(change_tracks(clip, cut), clip, body)
    assert all_finite(solution)
    upper = solved_joints(solution, body)[1][:, [12, 16, 17, 18, 19]]
    pixels, truth = clip.camera.project(upper), clip.camera.project(clip.joints[1][:, [12, 16, 17, 18, 19]])
    assert np.linalg.norm(pixels - truth, axis=-1).mean() < 8
    assert (solution.contacts[1] == 0).all()


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_clips_of_few_frames(quick, body, frames):
    clip = make_clip(body, [Walker(1.0, (-1, 5), 0.5), Walker(0.9, (1, 6), -1.0)], frames=frames)
    solution = run(clip.modalities, clip, body)
    assert all_finite(solution)
    assert solution.theta.shape == (2, frames, 24, 3)
    assert solution.gamma.shape == (2, frames, 3)


def empty_labels(clip: SyntheticClip) -> Modalities:
    return replace(clip.modalities, labels=np.zeros_like(clip.modalities.labels))


def no_depth(clip: SyntheticClip) -> Modalities:
    return replace(clip.modalities, disparity=None)


def flat_depth(clip: SyntheticClip) -> Modalities:
    assert clip.modalities.disparity is not None
    return replace(clip.modalities, disparity=np.full_like(clip.modalities.disparity, 0.5))


def black_depth(clip: SyntheticClip) -> Modalities:
    assert clip.modalities.disparity is not None
    return replace(clip.modalities, disparity=np.zeros_like(clip.modalities.disparity))


def missing_points(clip: SyntheticClip) -> Modalities:
    def lose(track):
        keypoints, confidence, landmarks = track.keypoints.copy(), track.confidence.copy(), track.landmarks.copy()
        keypoints[2:5, 7:15] = np.nan
        confidence[2:5, 7:15] = 0
        landmarks[3, 7:15] = np.nan
        return replace(track, keypoints=keypoints, confidence=confidence, landmarks=landmarks)

    return change_tracks(clip, lose)


def nobody_in_the_first_frame(clip: SyntheticClip) -> Modalities:
    def late(track):
        valid = track.valid.copy()
        valid[0] = False
        return replace(track, valid=valid, confidence=track.confidence * valid[:, None])

    return change_tracks(clip, late)


def one_never_seen(clip: SyntheticClip) -> Modalities:
    def blind(track):
        if track.id == 1:
            return track
        return replace(
            track, valid=track.valid & False, confidence=track.confidence * 0, keypoints=track.keypoints * 0,
            landmarks=track.landmarks * 0,
        )  # fmt: skip

    return change_tracks(clip, blind)


def numbers_that_are_none(clip: SyntheticClip) -> Modalities:
    """NaN and infinity in every modality, in some frames and places, with confidence as if nothing were wrong."""

    def spoil(track):
        keypoints, landmarks = track.keypoints.copy(), track.landmarks.copy()
        confidence = track.confidence.copy()
        keypoints[1, 3:9], keypoints[2, 10], keypoints[3] = np.nan, np.inf, -np.inf
        landmarks[2, 4:9], landmarks[4], landmarks[5, 3] = np.nan, np.inf, -np.inf
        confidence[6, :5], confidence[7, 7] = np.nan, np.inf
        return replace(track, keypoints=keypoints, landmarks=landmarks, confidence=confidence)

    assert clip.modalities.disparity is not None
    disparity = clip.modalities.disparity.copy()
    disparity[1, 20:60], disparity[2, :, 40:80], disparity[3] = np.nan, np.inf, np.nan
    disparity[4, 30:50] = -np.inf
    return replace(change_tracks(clip, spoil), disparity=disparity)


def disparity_of_no_numbers(clip: SyntheticClip) -> Modalities:
    assert clip.modalities.disparity is not None
    return replace(clip.modalities, disparity=np.full_like(clip.modalities.disparity, np.nan))


def a_frame_of_nobody(clip: SyntheticClip) -> Modalities:
    def away(track):
        valid = track.valid.copy()
        valid[3] = False
        keypoints, landmarks = track.keypoints.copy(), track.landmarks.copy()
        keypoints[3], landmarks[3] = np.nan, np.nan
        return replace(
            track, valid=valid, confidence=track.confidence * valid[:, None], keypoints=keypoints, landmarks=landmarks
        )

    labels = clip.modalities.labels.copy()
    labels[3] = 0
    return replace(change_tracks(clip, away), labels=labels)


def nobody_ever(clip: SyntheticClip) -> Modalities:
    return change_tracks(clip, lambda t: replace(t, valid=t.valid & False, confidence=t.confidence * 0))


def behind_the_camera(clip: SyntheticClip) -> Modalities:
    """Keypoints turned about their middle while landmarks stand: the place that fits best lies behind the camera."""

    def turn(track):
        middle = track.keypoints.mean(axis=1, keepdims=True)
        return replace(track, keypoints=2 * middle - track.keypoints)

    return change_tracks(clip, turn)


def two_in_one_place(clip: SyntheticClip) -> Modalities:
    first, second = clip.modalities.tracks
    return replace(clip.modalities, tracks=(first, replace(first, id=second.id)))


def all_points_in_one(clip: SyntheticClip) -> Modalities:
    return change_tracks(clip, lambda t: replace(t, keypoints=t.keypoints * 0 + 300, landmarks=t.landmarks * 0))


def out_of_the_picture(clip: SyntheticClip) -> Modalities:
    return change_tracks(clip, lambda track: replace(track, keypoints=track.keypoints - np.float32(3000)))


@pytest.mark.parametrize(
    "damage",
    [empty_labels, no_depth, flat_depth, black_depth, missing_points, nobody_in_the_first_frame, one_never_seen,
     numbers_that_are_none, disparity_of_no_numbers, a_frame_of_nobody, nobody_ever, behind_the_camera,
     two_in_one_place, all_points_in_one, out_of_the_picture],
)  # fmt: skip
def test_poor_evidence_gives_finite_answers(quick, body, damage):
    clip = make_clip(body, [Walker(1.0, (-1, 5), 0.5), Walker(0.9, (1, 6), -1.0)], frames=8)
    solution = run(damage(clip), clip, body)
    assert all_finite(solution)
    assert (solution.scales > 0.3).all()
    assert (solution.scales < 3).all()
    assert solution.ground.offset > 0


def test_what_is_no_number_does_not_spoil_the_rest(body):
    """Frames without damage are solved as well as if the others were not there."""
    clip = make_clip(body, [Walker(1.0, (-1, 5), 0.5), Walker(0.9, (1, 6), -1.0)], frames=8)
    solution = run(numbers_that_are_none(clip), clip, body)
    error = mpjpe(solved_joints(solution, body), clip, solution.scales)
    assert error[:, [0, 7]].mean() < 0.06
    assert solution.scales[1] / solution.scales[0] == pytest.approx(0.9, rel=0.15)


def test_two_people_in_one_place_do_not_fly_apart(quick, body):
    clip = make_clip(body, [Walker(1.0, (-1, 5), 0.5), Walker(0.9, (1, 6), -1.0)], frames=4)
    solution = run(two_in_one_place(clip), clip, body)
    places = solved_joints(solution, body)[:, :, 0]
    assert np.linalg.norm(places[1] - places[0], axis=-1).max() < 2.5
    assert (places[..., 2] > 1).all()


def test_bodies_stand_before_the_camera_whatever_the_start(quick, body):
    clip = make_clip(body, [Walker(1.0, (-1, 5), 0.5), Walker(0.9, (1, 6), -1.0)], frames=4)
    assert (solved_joints(run(behind_the_camera(clip), clip, body), body)[..., 0, 2] > 0.2).all()


@pytest.mark.parametrize("preset", ["fast", "exact"])
def test_the_least_there_can_be(quick, body, preset):
    """One person in one frame."""
    clip = make_clip(body, [Walker(1.0, (0, 5), 0.5)], frames=1)
    solution = solve(clip.modalities, clip.camera, body, SilentProgress(), PRESETS[preset])
    assert all_finite(solution)
    assert solution.scales[0] * body.height(solution.betas[0]) == pytest.approx(1.65, rel=0.05)
    assert solved_joints(solution, body)[0, 0, 0, 2] == pytest.approx(clip.joints[0, 0, 0, 2], rel=0.15)


def test_a_crowd_of_twenty(quick, body):
    walkers = [Walker(0.9 + 0.02 * (i % 6), (-2.4 + 1.2 * (i % 5), 5 + 1.5 * (i // 5)), 0.4 * i) for i in range(20)]
    clip = make_clip(body, walkers, frames=2)
    solution = run(clip.modalities, clip, body)
    assert all_finite(solution)
    roots, truth = solved_joints(solution, body)[:, :, 0], clip.joints[:, :, 0]
    # All in one unit of length: who stands where is right.
    size = np.median(roots[..., 2] / truth[..., 2])
    assert size == pytest.approx(1, abs=0.1)
    assert np.median(np.linalg.norm(roots / size - truth, axis=-1)) < 0.5


def test_exact_is_as_good_as_fast(quick, body):
    clip = make_clip(body, [Walker(1.0, (-1, 5), 0.5), Walker(0.9, (1, 6), -1.0)], frames=4)
    errors = []
    for preset in ("fast", "exact"):
        solution = solve(clip.modalities, clip.camera, body, SilentProgress(), PRESETS[preset])
        assert all_finite(solution)
        errors.append(mpjpe(solved_joints(solution, body), clip, solution.scales).mean())
    assert errors[1] < 1.15 * errors[0]


def test_a_blind_person_does_not_change_the_other(body):
    """Whoever was never seen has no say in the ground, the depth range or the size of the others."""
    clip = make_clip(body, [Walker(1.0, (-1, 5), 0.5), Walker(0.9, (1, 6), -1.0)], frames=8)
    both = one_never_seen(clip)
    alone = replace(both, tracks=both.tracks[:1])
    joint, single = run(both, clip, body), run(alone, clip, body)
    assert joint.scales[0] == pytest.approx(single.scales[0], rel=0.03)
    assert np.degrees(np.arccos(np.clip(joint.ground.normal @ single.ground.normal, -1, 1))) < 1.5


def test_two_runs_are_equal_bit_by_bit(quick, couple, body):
    first, second = (run(couple.modalities, couple, body) for _ in range(2))
    for name in ("theta", "gamma", "betas", "scales", "contacts", "inverse_far", "inverse_gap"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert first.ground.offset == second.ground.offset


def test_each_stage_is_shown_with_its_steps(quick, body):
    class Steps(SilentProgress):
        def __init__(self):
            self.seen = {}

        def stage(self, name, total):
            from contextlib import contextmanager

            @contextmanager
            def opened():
                done = []
                yield done.append
                self.seen[name] = (sum(done), total)

            return opened()

    clip, progress = make_clip(body, [Walker(1.0, (-1, 5), 0.5)], frames=3), Steps()
    solve(clip.modalities, clip.camera, body, progress, PRESETS["fast"])
    assert len(progress.seen) == 4
    for done, total in progress.seen.values():
        assert done == total > 0
