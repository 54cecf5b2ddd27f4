import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.body import kinematics
from core_solver.body.skeleton import joint_index, keypoint_index
from core_solver.geometry import matrix_from_rotvec
from core_solver.optimise.limb_pose import limb_pose
from tests.solver.body.synthetic import make_stick_body

BODY = make_stick_body()
REST_JOINTS, REST_KEYPOINTS = BODY.rest_joints(BODY.neutral_betas), BODY.rest_keypoints(BODY.neutral_betas)
BONES = [
    (keypoint_index(f"{side}_{a}"), keypoint_index(f"{side}_{b}"))
    for side in ("left", "right")
    for a, b in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
]


def keypoints_of(theta: np.ndarray) -> np.ndarray:
    rotations, positions = kinematics.pose_joints(theta, REST_JOINTS)
    return kinematics.skin(REST_KEYPOINTS, BODY.keypoint_weights, rotations, positions, REST_JOINTS)


def bone_angles(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Degrees between bones (T, 8) of keypoints (T, 25, 3)."""
    upper, lower = np.array(BONES).T
    a, b = (points[:, lower] - points[:, upper] for points in (found, truth))
    cosine = np.sum(a * b, axis=-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def plausible_pose(rng: np.random.Generator, frames: int) -> np.ndarray:
    """Any heading and posture of a stiff trunk, hinges that fold their own way."""
    theta = np.zeros((frames, 24, 3))
    theta[:, 0] = rng.normal(size=(frames, 3))
    for side, sign in (("left", 1), ("right", -1)):
        theta[:, joint_index(f"{side}_hip")] = rng.uniform((-1.8, -0.6, -0.3), (0.6, 0.6, 0.3), (frames, 3))
        theta[:, joint_index(f"{side}_knee"), 0] = rng.uniform(0, 2.4, frames)
        theta[:, joint_index(f"{side}_shoulder")] = rng.uniform((-1, -1, -1.4), (1, 1, 1.4), (frames, 3))
        theta[:, joint_index(f"{side}_elbow"), 1] = -sign * rng.uniform(0, 2.4, frames)
    return theta


@given(st.integers(0, 2**32 - 1))
def test_limbs_point_where_the_keypoints_do(seed):
    rng = np.random.default_rng(seed)
    truth = keypoints_of(plausible_pose(rng, 3))
    place = rng.normal(size=(3, 1, 3)) * 5
    found = keypoints_of(limb_pose(truth + place, REST_KEYPOINTS, REST_JOINTS))
    assert bone_angles(found, truth).max() < 2


def test_a_smaller_or_larger_skeleton_has_the_same_pose():
    truth = keypoints_of(plausible_pose(np.random.default_rng(0), 20))
    whole, half = (limb_pose(scale * truth, REST_KEYPOINTS, REST_JOINTS) for scale in (1.0, 0.5))
    np.testing.assert_allclose(matrix_from_rotvec(whole), matrix_from_rotvec(half), atol=1e-9)


def test_the_rest_pose_is_no_rotation():
    theta = limb_pose(REST_KEYPOINTS[None], REST_KEYPOINTS, REST_JOINTS)
    assert np.abs(theta).max() < 0.05


def test_a_clear_bend_gives_the_twist_of_the_upper_bone():
    """With the hinge bent the upper bone's twist shows: thigh and upper arm come back as they were."""
    theta = plausible_pose(np.random.default_rng(1), 30)
    for side, sign in (("left", 1), ("right", -1)):
        theta[:, joint_index(f"{side}_knee"), 0] = 1.2
        theta[:, joint_index(f"{side}_elbow"), 1] = -sign * 1.2
    found = matrix_from_rotvec(limb_pose(keypoints_of(theta), REST_KEYPOINTS, REST_JOINTS))
    for joint in [joint_index(f"{side}_{part}") for side in ("left", "right") for part in ("hip", "shoulder")]:
        difference = np.swapaxes(found[:, joint], -1, -2) @ matrix_from_rotvec(theta[:, joint])
        angle = np.degrees(np.arccos(np.clip((np.trace(difference, axis1=1, axis2=2) - 1) / 2, -1, 1)))
        assert np.median(angle) < 10
        assert angle.max() < 25


@pytest.mark.parametrize("part", ["knee", "elbow"])
def test_a_straight_limb_keeps_a_quiet_twist(part):
    """A straight limb shows no twist: a hair's breadth of bend to any side must not turn the upper bone about."""
    upper = {"knee": "hip", "elbow": "shoulder"}[part]
    rng = np.random.default_rng(2)
    straight = np.repeat(REST_KEYPOINTS[None], 20, axis=0)
    straight[:, [keypoint_index(f"{side}_{part}") for side in ("left", "right")]] += rng.normal(size=(20, 2, 3)) * 0.005
    theta = limb_pose(straight, REST_KEYPOINTS, REST_JOINTS)
    assert np.linalg.norm(theta[:, [joint_index(f"{side}_{upper}") for side in ("left", "right")]], axis=-1).max() < 0.3


@pytest.mark.parametrize("nothing", [np.zeros((2, 25, 3)), np.ones((2, 25, 3)) * 3.7])
def test_points_all_in_one_place_give_a_finite_pose(nothing):
    assert np.isfinite(limb_pose(nothing, REST_KEYPOINTS, REST_JOINTS)).all()


def test_a_limb_of_no_length_is_finite_and_leaves_the_others_right():
    truth = keypoints_of(plausible_pose(np.random.default_rng(3), 10))
    broken = truth.copy()
    for joint in ("left_elbow", "left_wrist"):
        broken[:, keypoint_index(joint)] = broken[:, keypoint_index("left_shoulder")]
    theta = limb_pose(broken, REST_KEYPOINTS, REST_JOINTS)
    assert np.isfinite(theta).all()
    assert bone_angles(keypoints_of(theta), truth)[:, 2:].max() < 2


def test_a_limb_folded_right_back_is_finite():
    folded = REST_KEYPOINTS[None].copy()
    folded[:, keypoint_index("left_wrist")] = folded[:, keypoint_index("left_shoulder")]
    folded[:, keypoint_index("right_ankle")] = folded[:, keypoint_index("right_hip")]
    assert np.isfinite(limb_pose(folded, REST_KEYPOINTS, REST_JOINTS)).all()
