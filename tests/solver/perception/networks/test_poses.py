"""Pose networks of every signature, from the declaration to keypoints in the picture."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from core_solver.body.skeleton import KEYPOINT_NAMES
from core_solver.errors import ModelError
from core_solver.perception.multipose import Pose
from core_solver.perception.networks.declared import open_declared
from core_solver.perception.networks.keypoint_sets import KEYPOINT_SETS
from core_solver.perception.networks.people import Person
from core_solver.perception.networks.top_down import read_heatmaps, read_simcc
from core_solver.perception.store import ModelStore
from tests.solver.perception.networks.graphs import (
    SPOT_WIDTH,
    declare,
    write_answers,
    write_heatmap_network,
    write_simcc_network,
)
from tests.solver.perception.people import standing_pose

SIZE = (96, 128)
LEVELS = 40 + 12 * np.arange(17)
PICTURE = (640, 480)
MEAN, STD = [10.0, 20.0, 30.0], [2.0, 3.0, 4.0]


def nobody(_image: np.ndarray) -> tuple[Pose, ...]:
    return ()


def picture_of(poses: list[Pose]) -> np.ndarray:
    """Each keypoint a disc of its own red, nothing in the other channels."""
    image = np.zeros((PICTURE[1], PICTURE[0], 3), np.uint8)
    for pose in poses:
        for point, level in zip(pose.keypoints, LEVELS, strict=True):
            centre = np.round((point - 0.5) * 16).astype(int).tolist()
            cv2.circle(image, centre, 5 * 16, (0, 0, int(level)), -1, cv2.LINE_AA, 4)
    return image


def spread_pose(x: float, y: float) -> Pose:
    """A person whose keypoints lie at least 24 pixels apart, so that discs do not cover each other."""
    grid = np.stack(np.meshgrid(np.arange(4), np.arange(5)), axis=-1).reshape(-1, 2)[:17]
    jitter = np.random.default_rng(3).uniform(-3, 3, (17, 2))
    points = (grid * (36, 40) + jitter + (x, y)).astype(np.float32)
    box = np.concatenate([points.min(axis=0) - 15, points.max(axis=0) + 15]).astype(np.float32)
    return Pose(0.7, box, points, np.full(17, 0.5, np.float32))


@pytest.mark.parametrize("decoder", ["heatmap", "simcc"])
@pytest.mark.parametrize("batch", ["N", 1])
@pytest.mark.parametrize("colour", ["rgb", "bgr"])
def test_top_down_networks_find_the_keypoints(tmp_path: Path, decoder: str, batch: int | str, colour: str) -> None:
    # The network sees normalised values, and looks at red wherever the declaration puts it.
    red = 0 if colour == "rgb" else 2
    levels = (LEVELS - MEAN[red]) / STD[red]
    write = write_heatmap_network if decoder == "heatmap" else write_simcc_network
    write(tmp_path / "a.onnx", SIZE, levels, batch, channel=red, width=SPOT_WIDTH / STD[red])
    toml = declare(
        tmp_path / "a.toml", task="pose", decoder=decoder, input=SIZE, colour=colour, mean=MEAN, std=STD, score=0.05
    )
    truth = [spread_pose(60, 40), spread_pose(350, 200)]
    declared = open_declared([toml], ModelStore(tmp_path), "cpu")
    assert declared.files == (toml, tmp_path / "a.onnx")
    found = declared.look(picture_of(truth), lambda _image: tuple(truth), (64, 48))
    for person, pose in zip(found, truth, strict=True):
        assert person.keypoints is not None
        assert person.keypoints.known.sum() == 17
        # One cell of the heatmap is 8 pixels of the picture, one bin of SimCC 2.
        distance = np.linalg.norm(person.pose.keypoints - pose.keypoints, axis=1)
        assert distance.max() < (3 if decoder == "heatmap" else 2)
        assert abs((person.pose.keypoints - pose.keypoints).mean(axis=0)).max() < 0.8
        assert (person.pose.confidence > 0.05).all()
        assert (person.keypoints.confidence[17:] == 0).all()


def test_unsure_keypoints_count_as_unseen(tmp_path: Path) -> None:
    write_simcc_network(tmp_path / "a.onnx", SIZE, LEVELS)
    toml = declare(tmp_path / "a.toml", task="pose", decoder="simcc", input=SIZE, score=0.99)
    pose = spread_pose(60, 40)
    (person,) = open_declared([toml], ModelStore(tmp_path), "cpu").look(picture_of([pose]), lambda _i: (pose,), (8, 6))
    assert (person.pose.confidence == 0).all()


def test_nobody_is_looked_at_where_nobody_is(tmp_path: Path) -> None:
    write_simcc_network(tmp_path / "a.onnx", SIZE, LEVELS)
    toml = declare(tmp_path / "a.toml", task="pose", decoder="simcc", input=SIZE)
    assert open_declared([toml], ModelStore(tmp_path), "cpu").look(picture_of([]), nobody, (8, 6)) == ()


def gaussian(centre: np.ndarray, shape: tuple[int, int], sigma: float = 2.0) -> np.ndarray:
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / (2 * sigma**2)).astype(np.float32)


@pytest.mark.parametrize(("refine", "most"), [("none", 0.71), ("quarter", 0.37), ("dark", 0.02)])
def test_heatmap_peaks_are_refined(refine: str, most: float) -> None:
    rng = np.random.default_rng(0)
    centres = rng.uniform(8, 40, (50, 2))
    maps = np.stack([gaussian(c, (64, 48)) for c in centres])[None]
    points, height = read_heatmaps(maps, (48 * 4, 64 * 4), refine, udp=False)
    cells = (points[0] - 0.5) / 4
    assert np.linalg.norm(cells - centres, axis=1).max() < most
    assert (height > 0.85).all()


def test_udp_puts_the_corner_cells_on_the_corner_pixels() -> None:
    maps = np.zeros((1, 2, 64, 48), np.float32)
    maps[0, 0, 0, 0] = maps[0, 1, 63, 47] = 1
    points, _ = read_heatmaps(maps, (192, 256), "quarter", udp=True)
    np.testing.assert_allclose(points[0], [[0.5, 0.5], [191.5, 255.5]])
    plain, _ = read_heatmaps(maps, (192, 256), "quarter", udp=False)
    np.testing.assert_allclose(plain[0], [[0.5, 0.5], [188.5, 252.5]])


def test_simcc_takes_two_bins_a_pixel_and_the_lesser_score() -> None:
    across, down = np.zeros((1, 1, 384), np.float32), np.zeros((1, 1, 512), np.float32)
    across[0, 0, 101], down[0, 0, 300] = 0.9, 0.4
    points, sure = read_simcc(across, down, (192, 256))
    np.testing.assert_allclose(points[0, 0], [51, 150.5])
    assert sure[0, 0] == np.float32(0.4)


STANDING = standing_pose(300, 50)


def in_input(pose: Pose, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Box and keypoints in a square input in whose middle the picture lies."""
    scale = side / PICTURE[0]
    shift = (0, (side - PICTURE[1] * scale) / 2)
    return (pose.box.reshape(2, 2) * scale + shift).ravel(), pose.keypoints * scale + shift


def rows_of(decoder: str, people: list[tuple[float, Pose]], side: int, points_in_set: int) -> dict[str, np.ndarray]:
    """What a network of this decoder says about people of these scores; the set's points beyond COCO's are 0."""
    boxes, flat, triples = [], [], []
    for score, pose in people:
        box, points = in_input(pose, side)
        triple = np.zeros((points_in_set, 3))
        triple[:17] = np.column_stack([points, pose.confidence])
        centre = np.concatenate([(box[:2] + box[2:]) / 2, box[2:] - box[:2]])
        boxes.append([*box, score])
        triples.append(triple)
        flat.append(np.concatenate([centre, [score], triple.ravel()]))
    if decoder == "rtmo":
        return {"dets": np.array([boxes]), "keypoints": np.array([triples])}
    if decoder == "yolo-pose":
        return {"output0": np.array(flat).T[None]}
    rows = [np.concatenate([box, [0], triple.ravel()]) for box, triple in zip(boxes, triples, strict=True)]
    return {"output0": np.array([rows])}


@pytest.mark.parametrize("decoder", ["rtmo", "yolo-pose", "yolo-pose-end2end"])
@pytest.mark.parametrize("keypoints", ["coco17", "halpe26"])
def test_one_stage_networks_find_people(tmp_path: Path, decoder: str, keypoints: str) -> None:
    other, doubled = standing_pose(120, 60), standing_pose(301, 52)
    people = [(0.6, doubled), (0.1, standing_pose(500, 20)), (0.9, STANDING), (0.8, other)]
    answers = rows_of(decoder, people, 320, KEYPOINT_SETS[keypoints].count)
    write_answers(tmp_path / "a.onnx", [1, 3, 320, 320], **answers)
    toml = declare(tmp_path / "a.toml", task="pose", decoder=decoder, input=[320, 320], keypoints=keypoints)
    image = np.zeros((PICTURE[1], PICTURE[0], 3), np.uint8)
    found = open_declared([toml], ModelStore(tmp_path), "cpu").look(image, nobody, (8, 6))
    assert [round(person.pose.score, 3) for person in found] == [0.9, 0.8]
    for person, pose in zip(found, (STANDING, other), strict=True):
        np.testing.assert_allclose(person.pose.keypoints, pose.keypoints, atol=1e-3)
        np.testing.assert_allclose(person.pose.box, pose.box, atol=1e-3)
        np.testing.assert_allclose(person.pose.confidence, pose.confidence, atol=1e-6)


def test_a_picture_without_people_gives_none(tmp_path: Path) -> None:
    write_answers(tmp_path / "a.onnx", [1, 3, 320, 320], output0=np.zeros((1, 56, 2100)))
    toml = declare(tmp_path / "a.toml", task="pose", decoder="yolo-pose", input=[320, 320])
    image = np.zeros((PICTURE[1], PICTURE[0], 3), np.uint8)
    assert open_declared([toml], ModelStore(tmp_path), "cpu").look(image, nobody, (8, 6)) == ()


def test_each_set_knows_left_from_right_and_heel_from_toe() -> None:
    for name, keypoints in KEYPOINT_SETS.items():
        numbers = np.arange(keypoints.count)
        named = keypoints.named(np.stack([numbers, numbers], axis=1), np.ones(keypoints.count))
        assert set(named.confidence) <= {0, 1}
        assert (named.points[~named.known] == 0).all(), name
        assert len(set(named.points[named.known, 0])) == named.known.sum(), name
        assert named.known[:17].all(), name

    def number(name: str, ours: str) -> int:
        return KEYPOINT_SETS[name].places[KEYPOINT_NAMES.index(ours)]

    # Facts of the sets' own definitions.
    assert (number("body25", "right_shoulder"), number("body25", "left_heel")) == (2, 21)
    assert (number("halpe26", "right_toe"), number("halpe26", "left_heel")) == (21, 24)
    assert (number("coco_wholebody133", "right_heel"), number("coco_wholebody133", "left_index")) == (22, 96)
    assert number("coco17", "left_heel") == -1


def test_two_networks_for_the_same_are_refused(tmp_path: Path) -> None:
    write_simcc_network(tmp_path / "a.onnx", SIZE, LEVELS)
    keys = {"task": "pose", "decoder": "simcc", "input": SIZE, "file": "a.onnx"}
    tomls = [declare(tmp_path / f"{name}.toml", **keys) for name in "ab"]
    with pytest.raises(ModelError, match=r"a.toml and b.toml both are poses of people's crops: give one of them"):
        open_declared(tomls, ModelStore(tmp_path), "cpu")


def test_keypoints_replace_those_of_the_finder() -> None:
    named = KEYPOINT_SETS["coco17"].named(STANDING.keypoints + 3, np.full(17, 0.9))
    person = Person(STANDING).with_keypoints(named)
    np.testing.assert_allclose(person.pose.keypoints, STANDING.keypoints + 3)
    assert person.pose.score == STANDING.score
