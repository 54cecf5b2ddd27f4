"""The open body as it is built from the fetched data, measured against what is known of people."""

import numpy as np
import pytest

from core_solver.body import JOINT_NAMES, KEYPOINT_NAMES, load_body, pose_joints, skin
from core_solver.body.makehuman import Phenotypes, Targets
from core_solver.body.open_body import build_open_body
from core_solver.body.smpl_keypoints import find_keypoints
from core_solver.errors import ModelError
from tests.solver.body import checks


@pytest.fixture(scope="session")
def body(models):
    return load_body(models.require("open-body"))


@pytest.mark.models
def test_it_keeps_the_contract(body):
    checks.assert_consistent(body)
    checks.assert_well_formed_mesh(body)
    checks.assert_anatomy(body)
    checks.assert_proxy_reaches_soles_and_hands(body, sole_depth=0.02)
    assert body.id == "open-body-1"
    assert "CC0" in body.licence
    assert (np.count_nonzero(body.weights, axis=1) <= 4).all()
    assert 450 <= len(body.proxy) <= 550


@pytest.mark.models
def test_every_shape_is_symmetric(body):
    for betas in (np.zeros(10), body.neutral_betas, np.random.default_rng(0).normal(size=10)):
        checks.assert_mirror_symmetric(body, betas, 1e-6)


@pytest.mark.models
def test_it_is_a_person_from_child_to_adult(body):
    assert 1.66 < body.height(body.neutral_betas) < 1.74
    stature = np.eye(10)[0]
    heights = [body.height(k * stature) for k in (-2.0, -1.0, 0.0, 1.0, 1.5)]
    assert heights == sorted(heights)
    assert heights[0] < 1.15
    assert heights[-1] > 1.80
    joints = dict(zip(JOINT_NAMES, body.rest_joints(body.neutral_betas), strict=True))
    # Segment lengths of a 1.70 m adult from anthropometric tables (Drillis and Contini: 0.245 and 0.246 of stature for
    # thigh and shin, 0.186 and 0.146 for upper arm and forearm). Their shoulder is the tip of the shoulder blade, ours
    # the centre of the joint some 3 cm below: hence 20 %.
    height = body.height(body.neutral_betas)
    for start, end, share in (("hip", "knee", 0.245), ("knee", "ankle", 0.246), ("shoulder", "elbow", 0.186),
                              ("elbow", "wrist", 0.146)):  # fmt: skip
        length = np.linalg.norm(joints[f"left_{end}"] - joints[f"left_{start}"])
        assert abs(length / height / share - 1) < 0.2, start


@pytest.mark.models
def test_it_rests_on_flat_feet_with_arms_to_the_side(body):
    rest = body.rest_vertices(body.neutral_betas)
    feet = (
        body.weights[:, [JOINT_NAMES.index(n) for n in JOINT_NAMES if n.endswith(("ankle", "foot"))]].sum(axis=1) > 0.5
    )
    soles = rest[feet & (rest[:, 1] < rest[:, 1].min() + 0.012)]
    for sign in (1, -1):
        sole = soles[sign * soles[:, 0] > 0]
        assert np.ptp(sole[:, 2]) > 0.18  # heel and ball both on the ground
    joints = body.rest_joints(body.neutral_betas)
    arm = joints[JOINT_NAMES.index("left_wrist")] - joints[JOINT_NAMES.index("left_shoulder")]
    assert arm[0] > 0.99 * np.linalg.norm(arm)


@pytest.mark.models
def test_joints_lie_inside_the_body(body):
    import trimesh

    girth = np.eye(10)[1]
    for betas in (
        body.neutral_betas,
        np.eye(10)[0] * -2,
        body.neutral_betas + 2 * girth,
        body.neutral_betas - 2 * girth,
    ):
        mesh = trimesh.Trimesh(body.rest_vertices(betas), body.faces, process=False)
        joints = body.rest_joints(betas)
        # The winding number by solid angles is 1 inside a closed surface and 0 outside.
        corners = mesh.triangles[None] - joints[:, None, None]
        length = np.linalg.norm(corners, axis=-1)
        a, b, c = np.moveaxis(corners, 2, 0)
        la, lb, lc = np.moveaxis(length, 2, 0)
        volume = np.einsum("nfi,nfi->nf", a, np.cross(b, c))
        spread = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
        winding = np.arctan2(volume, spread).sum(axis=1) / (2 * np.pi)
        np.testing.assert_allclose(winding, 1, atol=1e-6)


@pytest.mark.models
def test_bending_does_not_tear_the_skin(body):
    theta = np.zeros((24, 3))
    theta[JOINT_NAMES.index("left_elbow")] = [0, -1.5, 0]
    theta[JOINT_NAMES.index("left_knee")] = [1.5, 0, 0]
    rest_joints, rest = body.rest_joints(body.neutral_betas), body.rest_vertices(body.neutral_betas)
    posed = skin(rest, body.weights, *pose_joints(theta, rest_joints), rest_joints)
    edges = np.sort(np.concatenate([body.faces[:, [0, 1]], body.faces[:, [1, 2]], body.faces[:, [2, 0]]]), axis=1)
    before, after = (np.linalg.norm(v[edges[:, 0]] - v[edges[:, 1]], axis=1) for v in (rest, posed))
    assert np.max(after - before) < 0.06


@pytest.mark.models
def test_keypoints_found_by_geometry_agree_with_the_regressors_of_the_data(body):
    """The rule that serves SMPL files, on a body whose keypoints are known from elsewhere."""
    rest = body.rest_vertices(body.neutral_betas)
    found = find_keypoints(rest, body.joint_regressor, body.weights) @ rest
    error = np.linalg.norm(found - body.rest_keypoints(body.neutral_betas), axis=1)
    # Joints are left out: SMPL's rows are non-negative, the open body's are not.
    for name in ("nose", "left_eye", "right_ear", "left_heel", "right_toe", "left_index", "right_pinky"):
        assert error[KEYPOINT_NAMES.index(name)] < 0.03, name


def test_a_folder_without_the_data_is_refused(tmp_path):
    with pytest.raises(ModelError, match="fetch it again"):
        build_open_body(tmp_path, tmp_path / "body.npz")
    assert list(tmp_path.iterdir()) == []


def test_targets_are_multilinear_in_the_sliders():
    corners = (("male", "young"), ("female", "young"), ("female", "young", "maxheight"))
    targets = Targets(corners, np.arange(1, 4)[:, None, None] * np.ones((3, 1, 3)))

    def offset(gender: float, age: float, height: float) -> float:
        one = [np.array([v]) for v in (age, 0.5, 0.5, height, 0.5, gender)]
        return float(targets.apply(np.zeros((1, 3)), Phenotypes(*one, race=np.full((1, 3), 1 / 3)))[0, 0, 0])

    assert offset(0.0, 2 / 3, 0.0) == pytest.approx(1)
    assert offset(1.0, 2 / 3, 0.0) == pytest.approx(2)
    assert offset(1.0, 2 / 3, 1.0) == pytest.approx(2 + 3)
    assert offset(0.25, 2 / 3, 0.5) == pytest.approx(0.75 * 1 + 0.25 * 2 + 0.25 * 0.5 * 3)
    assert offset(0.0, 5 / 6, 0.0) == pytest.approx(0.5)  # half way to old, of which there is no target here
    assert offset(0.0, 0.2, 0.0) == pytest.approx(0)
