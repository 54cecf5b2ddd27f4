"""SMPL regressors of every form: the landmarks are those of the pose that the network's numbers encode."""

import math
from pathlib import Path

import numpy as np
import pytest

from core_solver.body import pose_joints, skin
from core_solver.errors import ModelError
from core_solver.geometry import align_vectors, matrix_from_rotvec
from core_solver.perception.multipose import Pose
from core_solver.perception.networks import declared as declared_module
from core_solver.perception.networks.declared import open_declared
from core_solver.perception.networks.people import Person
from core_solver.perception.networks.smpl import read_rotations
from core_solver.perception.store import ModelStore
from tests.solver.body.synthetic import make_stick_body
from tests.solver.perception.networks.graphs import declare, write_answers, write_answers_per_person
from tests.solver.perception.people import standing_pose

BODY = make_stick_body()
IMAGE = np.zeros((480, 640, 3), np.uint8)


class BodyStore(ModelStore):
    """A store whose open body is the stick body."""

    def require(self, name: str) -> Path:
        assert name == "open-body"
        return self.models_dir / "open_body.npz"


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModelStore:
    monkeypatch.setattr(declared_module, "load_body", lambda _path: BODY)
    return BodyStore(tmp_path)


def random_theta(seed: int, hands: bool = True) -> np.ndarray:
    """(24, 3) upright in the camera's axes, which for SMPL's y-up body is half a turn about x."""
    rng = np.random.default_rng(seed)
    theta = rng.uniform(-0.5, 0.5, (24, 3))
    theta[0] = (math.pi * 0.97, 0.1, -0.1)
    if not hands:
        theta[22:] = 0
    return theta


def truth(theta: np.ndarray) -> np.ndarray:
    """(25, 3) keypoints in the camera's axes, origin at the mid-hips."""
    joints = BODY.rest_joints(BODY.neutral_betas)
    turns, positions = pose_joints(theta, joints)
    rest = BODY.rest_keypoints(BODY.neutral_betas)
    points = skin(rest, BODY.keypoint_weights, turns, positions, joints)
    return points - points[[11, 12]].mean(axis=0)


def encoded(theta: np.ndarray, form: str) -> np.ndarray:
    """(J, n) numbers of the rotations (J, 3)."""
    if form == "axis-angle":
        return theta
    matrices = matrix_from_rotvec(theta)
    if form == "matrix":
        return matrices.reshape(-1, 9)
    return (matrices[:, :, :2] if form == "6d" else matrices[:, :2, :]).reshape(-1, 6)


@pytest.mark.parametrize("form", ["matrix", "6d", "6d-rows", "axis-angle"])
@pytest.mark.parametrize("parts", ["one", "two", "without hands"])
@pytest.mark.parametrize("batch", ["N", 1])
def test_landmarks_are_those_of_the_pose(
    tmp_path: Path, store: ModelStore, form: str, parts: str, batch: int | str
) -> None:
    theta = random_theta(1, hands=parts != "without hands")
    numbers = encoded(theta, form)
    numbers = numbers[:22] if parts == "without hands" else numbers
    flat = {"pose": numbers.ravel()}
    if parts == "two":
        flat = {"global_orient": numbers[:1].ravel(), "body_pose": numbers[1:].ravel()}
    write_answers_per_person(tmp_path / "hmr.onnx", [batch, 3, 256, 256], **flat, betas=np.ones(10))
    toml = declare(tmp_path / "hmr.toml", task="smpl", decoder="smpl", input=[256, 256], rotations=form)
    poses = standing_pose(200, 40), standing_pose(420, 30)
    declared = open_declared([toml], store, "cpu")
    assert declared.files == (toml, tmp_path / "hmr.onnx", tmp_path / "open_body.npz")
    found = declared.look(IMAGE, lambda _image: poses, (64, 48))
    for person in found:
        assert person.landmarks is not None
        np.testing.assert_allclose(person.landmarks, truth(theta), atol=1e-4)
    # Upright: the head above the feet, where y points down.
    assert truth(theta)[0, 1] < truth(theta)[17, 1] - 1


def test_matrices_as_networks_give_them(tmp_path: Path, store: ModelStore) -> None:
    theta = random_theta(2)
    matrices = matrix_from_rotvec(theta)
    write_answers_per_person(
        tmp_path / "hmr.onnx", ["N", 3, 256, 256], global_orient=matrices[:1], body_pose=matrices[1:] * 1.01
    )
    toml = declare(tmp_path / "hmr.toml", task="smpl", decoder="smpl", input=[256, 256], axes="camera")
    (person,) = open_declared([toml], store, "cpu").look(IMAGE, lambda _image: (standing_pose(200, 40),), (8, 6))
    np.testing.assert_allclose(person.landmarks, truth(theta), atol=1e-4)


def test_axes_that_point_up_are_turned(tmp_path: Path, store: ModelStore) -> None:
    theta = np.zeros((24, 3))  # stands upright where y points up, faces along z
    write_answers_per_person(tmp_path / "hmr.onnx", ["N", 3, 256, 256], pose=theta.ravel())
    toml = declare(
        tmp_path / "hmr.toml", task="smpl", decoder="smpl", input=[256, 256], rotations="axis-angle", axes="y-up"
    )
    (person,) = open_declared([toml], store, "cpu").look(IMAGE, lambda _image: (standing_pose(200, 40),), (8, 6))
    assert person.landmarks is not None
    np.testing.assert_allclose(person.landmarks, truth(theta) * (1, -1, -1), atol=1e-5)
    assert person.landmarks[0, 1] < -0.5
    assert person.landmarks[0, 2] < 0  # the nose towards the camera


def test_a_full_translation_tells_the_viewing_ray(tmp_path: Path, store: ModelStore) -> None:
    theta, place = random_theta(3), np.array([1.5, -0.4, 3.0])
    write_answers_per_person(tmp_path / "a.onnx", ["N", 3, 256, 256], pose=theta.ravel(), camera=place)
    toml = declare(
        tmp_path / "a.toml", task="smpl", decoder="smpl", input=[256, 256], rotations="axis-angle", camera="translation"
    )  # fmt: skip
    (person,) = open_declared([toml], store, "cpu").look(IMAGE, lambda _image: (standing_pose(200, 40),), (8, 6))
    assert person.landmarks is not None
    # Turned from the ray's frame into the camera's, they are what the network saw.
    back = person.landmarks @ align_vectors([0.0, 0.0, 1.0], place).T
    np.testing.assert_allclose(back, truth(theta), atol=1e-4)
    assert np.abs(person.landmarks - truth(theta)).max() > 0.1


def seen_through(points: np.ndarray, camera: np.ndarray, form: str) -> np.ndarray:
    """(25, 2) pixels of a 512 x 512 input by the definition of each camera."""
    if form == "translation":
        there = points + camera
        focal = 256 / math.tan(math.radians(30))
        return there[:, :2] / there[:, 2:] * focal + 256
    unit = points[:, :2] * camera[0] + camera[1:] * (camera[0] if form == "hmr" else 1)
    return 256 + 256 * unit


def pose_at(pixels: np.ndarray) -> Pose:
    points = pixels[:17].astype(np.float32)
    box = np.concatenate([points.min(axis=0), points.max(axis=0)])
    return Pose(0.8, box, points, np.full(17, 0.7, np.float32))


CAMERAS = {
    "hmr": np.array([[0.5, -0.8, 0.1], [0.6, 0.7, -0.1], [0.5, 0, 0]]),
    "romp": np.array([[0.5, -0.4, 0.05], [0.6, 0.4, -0.1], [0.5, 0, 0]]),
    "translation": np.array([[-1.0, 0.2, 4.0], [1.2, -0.1, 5.0], [0, 0, 5.0]]),
}


@pytest.mark.parametrize("form", ["hmr", "romp", "translation"])
def test_regressors_of_whole_pictures_find_whose_body_is_whose(tmp_path: Path, store: ModelStore, form: str) -> None:
    thetas = np.stack([random_theta(seed) for seed in (4, 5, 6)])
    cameras = CAMERAS[form]
    write_answers(
        tmp_path / "romp.onnx", [1, 512, 512, 3],
        pose=thetas.reshape(3, 72), cam=cameras, scores=np.array([0.9, 0.8, 0.1]),
    )  # fmt: skip
    toml = declare(
        tmp_path / "romp.toml", task="smpl", decoder="smpl", sees="picture", input=[512, 512], layout="NHWC",
        colour="bgr", rotations="axis-angle", camera=form, fov_degrees=60,
    )  # fmt: skip
    # The picture, 640 x 480, lies in the middle of the input at 0.8 of its size.
    poses = [
        pose_at((seen_through(truth(theta), camera, form) - (0, 64)) / 0.8)
        for theta, camera in zip(thetas, cameras, strict=True)
    ]
    people = (poses[1], poses[2], poses[0])  # the third body was too unsure
    found = open_declared([toml], store, "cpu").look(IMAGE, lambda _image: people, (64, 48))
    assert [person.landmarks is None for person in found] == [False, True, False]
    for person, number in ((found[0], 1), (found[2], 0)):
        expected = truth(thetas[number])
        if form == "translation":
            expected = expected @ align_vectors(cameras[number], [0.0, 0.0, 1.0]).T
        np.testing.assert_allclose(person.landmarks, expected, atol=1e-4)


def test_romp_is_read_as_it_leaves_the_network(tmp_path: Path, store: ModelStore) -> None:
    thetas = np.stack([random_theta(seed, hands=False) for seed in (4, 5)])
    cameras, places = CAMERAS["romp"][:2], [(30, 20), (28, 45)]
    centers, params = np.zeros((1, 1, 64, 64)), np.random.default_rng(0).normal(size=(1, 145, 64, 64))
    for theta, camera, (row, column) in zip(thetas, cameras, places, strict=True):
        centers[0, 0, row - 1 : row + 2, column - 1 : column + 2] = 0.5  # the slopes of a peak are no further people
        centers[0, 0, row, column] = 0.8
        params[0, :3, row, column] = [math.log(camera[0]) / math.log(1.1), *camera[1:]]
        params[0, 3:135, row, column] = encoded(theta, "6d")[:22].ravel()
    centers[0, 0, 50, 50] = 0.2
    write_answers(tmp_path / "romp.onnx", [1, 512, 512, 3], center_maps=centers, params_maps=params)
    toml = declare(
        tmp_path / "romp.toml", task="smpl", decoder="romp-maps", input=[512, 512], layout="NHWC", pad=0, score=0.25
    )
    poses = [
        pose_at((seen_through(truth(theta), camera, "romp") - (0, 64)) / 0.8)
        for theta, camera in zip(thetas, cameras, strict=True)
    ]
    found = open_declared([toml], store, "cpu").look(IMAGE, lambda _image: tuple(poses[::-1]), (64, 48))
    for person, theta in zip(found, thetas[::-1], strict=True):
        np.testing.assert_allclose(person.landmarks, truth(theta), atol=1e-4)


def test_no_bodies_in_a_picture(tmp_path: Path, store: ModelStore) -> None:
    write_answers(tmp_path / "a.onnx", [1, 3, 512, 512], pose=np.zeros((0, 72)), cam=np.zeros((0, 3)))
    toml = declare(
        tmp_path / "a.toml",
        task="smpl",
        decoder="smpl",
        sees="picture",
        input=[512, 512],
        rotations="axis-angle",
        camera="romp",
    )
    pose = standing_pose(200, 40)
    assert open_declared([toml], store, "cpu").look(IMAGE, lambda _image: (pose,), (8, 6)) == (Person(pose),)


def test_numbers_that_are_no_24_joints(tmp_path: Path, store: ModelStore) -> None:
    pose = standing_pose(200, 40)
    for length, words in ((71, "are no rotations of the form"), (69, "are 23 joints: 24 or 22 are wanted")):
        write_answers_per_person(tmp_path / "a.onnx", ["N", 3, 256, 256], pose=np.zeros(length))
        toml = declare(tmp_path / "a.toml", task="smpl", decoder="smpl", input=[256, 256], rotations="axis-angle")
        with pytest.raises(ModelError, match=f"a.onnx is not as a.toml declares: .*{words}"):
            open_declared([toml], store, "cpu").look(IMAGE, lambda _image: (pose,), (8, 6))


def test_a_camera_that_is_declared_must_be_there(tmp_path: Path, store: ModelStore) -> None:
    write_answers_per_person(tmp_path / "a.onnx", ["N", 3, 256, 256], pose=np.zeros(72))
    toml = declare(
        tmp_path / "a.toml", task="smpl", decoder="smpl", input=[256, 256], rotations="axis-angle", camera="hmr"
    )
    with pytest.raises(ModelError, match=r"no output is the camera: name it with outputs.camera"):
        open_declared([toml], store, "cpu")


def test_bodies_that_are_no_numbers_are_none(tmp_path: Path, store: ModelStore) -> None:
    write_answers_per_person(tmp_path / "a.onnx", ["N", 3, 256, 256], pose=np.full(72, np.nan))
    toml = declare(tmp_path / "a.toml", task="smpl", decoder="smpl", input=[256, 256], rotations="axis-angle")
    (person,) = open_declared([toml], store, "cpu").look(IMAGE, lambda _image: (standing_pose(200, 40),), (8, 6))
    assert person.landmarks is None


def test_rotations_are_rotations() -> None:
    rng = np.random.default_rng(7)
    for form, count in (("matrix", 9), ("6d", 6), ("6d-rows", 6), ("axis-angle", 3)):
        matrices = read_rotations(rng.normal(size=(5, 24 * count)), None, form)
        np.testing.assert_allclose(
            matrices @ np.swapaxes(matrices, -1, -2), np.tile(np.eye(3), (5, 24, 1, 1)), atol=1e-9
        )
        np.testing.assert_allclose(np.linalg.det(matrices), 1, atol=1e-9)
