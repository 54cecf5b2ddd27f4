"""What must hold of every body model, whatever it was built from."""

from itertools import pairwise

import numpy as np
import trimesh
from scipy.spatial import KDTree

from core_solver.body import JOINT_NAMES, KEYPOINT_NAMES, MIRROR, BodyModel
from core_solver.body.skeleton import KEYPOINT_MIRROR, joint_index

FLIP = np.array([-1.0, 1.0, 1.0])


def assert_consistent(body: BodyModel) -> None:
    count = len(body.template)
    assert body.template.shape == (count, 3)
    assert body.shape_directions.shape == (count, 3, 10)
    assert body.joint_regressor.shape == (24, count)
    assert body.weights.shape == (count, 24)
    assert body.keypoint_regressor.shape == (25, count)
    assert body.faces.dtype == np.int32
    assert body.neutral_betas.shape == (10,)
    for rows in (body.joint_regressor, body.weights, body.keypoint_regressor, body.keypoint_weights):
        np.testing.assert_allclose(rows.sum(axis=1), 1, atol=1e-6)
    assert (body.weights >= 0).all()
    assert (body.keypoint_regressor >= 0).all()
    assert set(body.faces.ravel()) == set(range(count))
    assert len(set(body.proxy)) == len(body.proxy)


def assert_proxy_reaches_soles_and_hands(body: BodyModel, sole_depth: float) -> None:
    """At least 20 proxy vertices within `sole_depth` metres of each foot's lowest point, and both hands' tips."""
    rest = body.rest_vertices(body.neutral_betas)
    for side in ("left", "right"):
        foot = body.weights[:, [joint_index(f"{side}_ankle"), joint_index(f"{side}_foot")]].sum(axis=1) > 0.5
        ground = rest[foot, 1].min()
        in_proxy = np.isin(np.arange(len(rest)), body.proxy)
        assert np.sum(foot & in_proxy & (rest[:, 1] < ground + sole_depth)) >= 20
        assert rest[body.proxy][:, 1].min() == rest[:, 1].min()
        hand = body.weights[:, joint_index(f"{side}_hand")] > 0.5
        tip = np.flatnonzero(hand)[np.argmax(np.abs(rest[hand, 0]))]
        assert np.min(np.linalg.norm(rest[body.proxy] - rest[tip], axis=1)) < 0.03


def assert_well_formed_mesh(body: BodyModel) -> None:
    mesh = trimesh.Trimesh(body.rest_vertices(body.neutral_betas), body.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0  # outward orientation
    assert mesh.area_faces.min() > 1e-7


def assert_mirror_symmetric(body: BodyModel, betas: np.ndarray, tolerance: float) -> None:
    rest, joints, keypoints = body.rest_vertices(betas), body.rest_joints(betas), body.rest_keypoints(betas)
    assert KDTree(rest).query(rest * FLIP)[0].max() < tolerance
    np.testing.assert_allclose(joints[list(MIRROR)] * FLIP, joints, atol=tolerance)
    np.testing.assert_allclose(keypoints[list(KEYPOINT_MIRROR)] * FLIP, keypoints, atol=tolerance)


def assert_anatomy(body: BodyModel) -> None:
    """Every joint and keypoint on its side and in its order, in SMPL's axes."""
    betas = body.neutral_betas
    joint = dict(zip(JOINT_NAMES, body.rest_joints(betas), strict=True))
    point = dict(zip(KEYPOINT_NAMES, body.rest_keypoints(betas), strict=True))
    for name, place in (*joint.items(), *point.items()):
        if name.startswith("left_"):
            assert place[0] > 0.01, name
    rising = [
        "left_foot",
        "left_ankle",
        "left_knee",
        "left_hip",
        "pelvis",
        "spine1",
        "spine2",
        "spine3",
        "neck",
        "head",
    ]
    assert all(joint[low][1] < joint[high][1] for low, high in pairwise(rising))
    outwards = ["left_collar", "left_shoulder", "left_elbow", "left_wrist", "left_hand"]
    assert all(joint[near][0] < joint[far][0] for near, far in pairwise(outwards))
    assert point["left_heel"][2] < point["left_ankle"][2] < point["left_toe"][2]
    assert point["left_index"][2] > point["left_pinky"][2]  # palms down
    assert point["nose"][2] > point["left_eye"][2] > point["left_ear"][2]
    assert point["left_eye"][1] > point["nose"][1] > point["left_shoulder"][1]
    for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"):
        assert np.linalg.norm(point[f"left_{name}"] - joint[f"left_{name}"]) < 0.07, name
