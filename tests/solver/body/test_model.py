"""The body model's own functions, on the body of boxes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.body import load_body, load_open_body, pose_joints, skin
from core_solver.body.proxy import choose_proxy
from core_solver.body.regressors import fit_regressor
from core_solver.errors import ModelError
from tests.solver.body import checks
from tests.solver.body.synthetic import make_stick_body

BODY = make_stick_body()


def save_as_open_body(path, **changes):
    fields = (
        "id", "licence", "template", "shape_directions", "joint_regressor", "weights", "faces", "keypoint_regressor",
        "neutral_betas", "proxy",
    )  # fmt: skip
    np.savez(path, **{name: np.asarray(getattr(BODY, name)) for name in fields} | changes)
    return path


def test_the_stick_body_keeps_the_contract():
    checks.assert_consistent(BODY)
    checks.assert_proxy_reaches_soles_and_hands(BODY, sole_depth=1e-6)
    checks.assert_well_formed_mesh(BODY)
    checks.assert_mirror_symmetric(BODY, np.linspace(-1, 1, 10), 1e-9)
    checks.assert_anatomy(BODY)
    assert BODY.height(BODY.neutral_betas) == pytest.approx(1.70)


@given(seed=st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_joints_and_keypoints_are_regressed_from_the_same_shape(seed):
    betas = np.random.default_rng(seed).normal(size=10)
    rest = BODY.rest_vertices(betas)
    np.testing.assert_allclose(BODY.rest_joints(betas), BODY.joint_regressor @ rest, atol=1e-12)
    np.testing.assert_allclose(BODY.rest_keypoints(betas), BODY.keypoint_regressor @ rest, atol=1e-12)
    assert BODY.height(betas) == pytest.approx(rest[:, 1].max() - rest[:, 1].min())


def test_rest_shapes_take_a_batch_of_betas():
    betas = np.random.default_rng(0).normal(size=(3, 10))
    np.testing.assert_allclose(BODY.rest_vertices(betas)[2], BODY.rest_vertices(betas[2]))
    assert BODY.rest_joints(betas).shape == (3, 24, 3)


def test_a_keypoint_inside_one_bone_is_skinned_exactly_like_its_vertices():
    rest = BODY.rest_joints(np.zeros(10))
    posed = pose_joints(np.random.default_rng(1).normal(0, 0.5, (24, 3)), rest)
    vertices = skin(BODY.template, BODY.weights, *posed, rest)
    keypoints = skin(BODY.keypoint_template, BODY.keypoint_weights, *posed, rest)
    # On a rigid bone both ways agree; where bones blend they may differ, but never by much.
    toe = 19
    assert np.isclose(BODY.keypoint_weights[toe].max(), 1)
    np.testing.assert_allclose(keypoints[toe], BODY.keypoint_regressor[toe] @ vertices, atol=1e-12)
    assert np.linalg.norm(keypoints - BODY.keypoint_regressor @ vertices, axis=1).max() < 0.05


def test_an_open_body_file_comes_back_whole(tmp_path):
    loaded = load_body(save_as_open_body(tmp_path / "body.npz"))
    assert (loaded.id, loaded.licence) == (BODY.id, BODY.licence)
    for name in ("template", "shape_directions", "weights", "faces", "keypoint_regressor", "proxy"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(BODY, name))


def test_foreign_and_damaged_files_are_refused(tmp_path):
    with pytest.raises(ModelError, match="no such"):
        load_body(tmp_path / "absent.npz")
    other = tmp_path / "other.npz"
    np.savez(other, weights=np.zeros(3))
    with pytest.raises(ModelError, match="lacks 'v_template'"):
        load_body(other)
    cut = tmp_path / "cut.npz"
    cut.write_bytes(save_as_open_body(tmp_path / "body.npz").read_bytes()[:5000])
    with pytest.raises(ModelError):
        load_open_body(cut)
    objects = np.array([{"run": "this"}], dtype=object)
    with pytest.raises(ModelError):
        load_body(save_as_open_body(tmp_path / "objects.npz", template=objects))
    with pytest.raises(ModelError, match="do not fit"):
        load_body(save_as_open_body(tmp_path / "short.npz", template=BODY.template[:-1]))


def test_regressor_gives_points_inside_the_body_for_every_shape():
    rng = np.random.default_rng(2)
    truth = np.zeros((4, len(BODY.template)))
    for row, centre in zip(truth, BODY.template[[50, 150, 250, 400]], strict=True):
        near = np.argsort(np.linalg.norm(BODY.template - centre, axis=1))[:30]
        row[near] = rng.dirichlet(np.ones(30))
    points, moves = truth @ BODY.template, np.tensordot(truth, BODY.shape_directions, axes=1)
    for convex in (True, False):
        rows = fit_regressor(BODY.template, BODY.shape_directions, points, moves, convex=convex)
        np.testing.assert_allclose(rows.sum(axis=1), 1)
        assert not convex or (rows >= 0).all()
        np.testing.assert_allclose(rows @ BODY.template, points, atol=2e-3)
        np.testing.assert_allclose(np.tensordot(rows, BODY.shape_directions, axes=1), moves, atol=2e-3)


def test_proxy_is_even_and_keeps_soles():
    grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 12)] * 3), axis=-1).reshape(-1, 3)
    weights = np.zeros((len(grid), 24))
    weights[:, 0] = 1
    left, right = grid[:, 0] > 0.3, grid[:, 0] < -0.3
    low = grid[:, 1] < 0
    for part, side in ((left, 0), (right, 1)):
        weights[part & low] = np.eye(24)[7 + side]
        weights[part & ~low] = np.eye(24)[20 + side]
    proxy = choose_proxy(grid, weights, count=200)
    assert len(proxy) == len(set(proxy)) == 200
    spacing = np.min(np.linalg.norm(grid[:, None] - grid[proxy], axis=-1), axis=1)
    assert spacing.max() < 0.3
    assert np.sum(grid[proxy][:, 1] == -0.5) >= 48
    assert len(choose_proxy(grid[:100], weights[:100])) == 100
