"""Mask networks of every signature: each person gets the mask that holds their keypoints."""

from pathlib import Path

import numpy as np
import pytest

from core_solver.errors import ModelError
from core_solver.perception.networks.declared import open_declared
from core_solver.perception.networks.instances import read_mask2former, read_rtmdet, read_yolo_seg
from core_solver.perception.networks.people import cropped
from core_solver.perception.store import ModelStore
from tests.solver.perception.networks.graphs import declare, write_answers
from tests.solver.perception.people import standing_pose

PICTURE = (640, 480)
LABELS = (384, 288)
LEFT, RIGHT = standing_pose(180, 50), standing_pose(450, 40)
STRANGER = standing_pose(20, -300)  # whom no network masks


def body_box(pose) -> np.ndarray:
    return pose.box + np.float32([-5, -5, 5, 5])


def in_square(box: np.ndarray, side: int) -> np.ndarray:
    """A picture's box in a square input in whose middle the picture lies."""
    scale = side / PICTURE[0]
    return box * scale + np.tile([0, (side - PICTURE[1] * scale) / 2], 2)


def drawn(box: np.ndarray, side: int) -> np.ndarray:
    """(side, side) with 1 in a box."""
    mask = np.zeros((side, side))
    left, top, right, bottom = np.round(box).astype(int)
    mask[max(top, 0) : bottom, max(left, 0) : right] = 1
    return mask


def answers_of(decoder: str, side: int, grid: int) -> dict[str, np.ndarray]:
    """Two people, the second one first; a dog over the left one; a faint person over both."""
    boxes = [in_square(body_box(p), side) for p in (RIGHT, LEFT, LEFT)] + [np.array([0, 0, side, side])]
    scores, classes = [0.9, 0.8, 0.95, 0.1], [0, 0, 16, 0]
    masks = np.stack([drawn(box * grid / side, grid) for box in boxes])
    if decoder == "rtmdet-ins":
        dets = np.column_stack([boxes, scores])
        return {"dets": dets[None], "labels": np.array([classes]), "masks": masks[None]}
    if decoder == "mask2former":
        logits = np.full((4, 81), -30.0)
        logits[range(4), classes] = np.log(scores)
        logits[:, 80] = np.log(1 - np.array(scores))  # "nothing"
        return {"class_queries_logits": logits[None], "masks_queries_logits": 20 * masks[None] - 10}
    # YOLO-seg: the prototypes are the masks' columns and rows; inside the box a mask is their sum less a threshold.
    scored = np.zeros((4, 80))
    scored[range(4), classes] = scores
    corners = np.array(boxes)
    centres = np.concatenate([(corners[:, :2] + corners[:, 2:]) / 2, corners[:, 2:] - corners[:, :2]], axis=1)
    coefficients = np.zeros((4, 32))
    coefficients[range(4), range(4)] = 20
    coefficients[:, 31] = -10
    protos = np.concatenate([masks, np.zeros((27, grid, grid)), np.ones((1, grid, grid))])
    return {"output0": np.concatenate([centres, scored, coefficients], axis=1).T[None], "output1": protos[None]}


def truth(pose) -> np.ndarray:
    scale = np.tile(np.array(LABELS) / PICTURE, 2)
    mask = np.zeros((LABELS[1], LABELS[0]), bool)
    left, top, right, bottom = np.round(body_box(pose) * scale).astype(int)
    mask[max(top, 0) : bottom, max(left, 0) : right] = True
    return mask


@pytest.mark.parametrize("decoder", ["rtmdet-ins", "yolo-seg", "mask2former"])
def test_people_get_their_own_masks(tmp_path: Path, decoder: str) -> None:
    grid = 320 if decoder == "rtmdet-ins" else 80
    write_answers(tmp_path / "a.onnx", [1, 3, 320, 320], **answers_of(decoder, 320, grid))
    toml = declare(tmp_path / "a.toml", task="masks", decoder=decoder, input=[320, 320])
    image = np.zeros((PICTURE[1], PICTURE[0], 3), np.uint8)
    poses = (LEFT, STRANGER, RIGHT)
    found = open_declared([toml], ModelStore(tmp_path), "cpu").look(image, lambda _image: poses, LABELS)
    assert [person.pose for person in found] == list(poses)
    assert found[1].mask is None
    for person in (found[0], found[2]):
        assert person.mask is not None
        plane = np.zeros((LABELS[1], LABELS[0]), bool)
        rows, columns = person.mask.values.shape
        top, left = person.mask.top, person.mask.left
        plane[top : top + rows, left : left + columns] = person.mask.values > 127
        expected = truth(person.pose)
        assert (plane & expected).sum() / (plane | expected).sum() > 0.93


def test_without_people_the_network_is_not_asked(tmp_path: Path) -> None:
    write_answers(tmp_path / "a.onnx", [1, 3, 320, 320], **answers_of("rtmdet-ins", 320, 320))
    toml = declare(tmp_path / "a.toml", task="masks", decoder="rtmdet-ins", input=[320, 320])
    image = np.zeros((PICTURE[1], PICTURE[0], 3), np.uint8)
    assert open_declared([toml], ModelStore(tmp_path), "cpu").look(image, lambda _image: (), LABELS) == ()


def test_no_finds_leave_everybody_without_mask(tmp_path: Path) -> None:
    answers = {"dets": np.zeros((1, 0, 5)), "labels": np.zeros((1, 0)), "masks": np.zeros((1, 0, 320, 320))}
    write_answers(tmp_path / "a.onnx", [1, 3, 320, 320], **answers)
    toml = declare(tmp_path / "a.toml", task="masks", decoder="rtmdet-ins", input=[320, 320])
    image = np.zeros((PICTURE[1], PICTURE[0], 3), np.uint8)
    found = open_declared([toml], ModelStore(tmp_path), "cpu").look(image, lambda _image: (LEFT,), LABELS)
    assert [person.mask for person in found] == [None]


def test_outputs_that_do_not_fit_together(tmp_path: Path) -> None:
    image = np.zeros((PICTURE[1], PICTURE[0], 3), np.uint8)
    answers = {"output0": np.zeros((1, 36, 100)), "output1": np.zeros((1, 32, 80, 80))}
    write_answers(tmp_path / "a.onnx", [1, 3, 320, 320], **answers)
    toml = declare(tmp_path / "a.toml", task="masks", decoder="yolo-seg", input=[320, 320])
    with pytest.raises(ModelError, match=r"a.onnx do not fit together: .*leave no class 0"):
        open_declared([toml], ModelStore(tmp_path), "cpu").look(image, lambda _image: (LEFT,), LABELS)
    answers = {"dets": np.ones((1, 5, 5)), "labels": np.zeros((1, 5)), "masks": np.zeros((1, 4, 80, 80))}
    write_answers(tmp_path / "a.onnx", [1, 3, 320, 320], **answers)
    toml = declare(tmp_path / "a.toml", task="masks", decoder="rtmdet-ins", input=[320, 320])
    with pytest.raises(ModelError, match=r"a.onnx do not fit together"):
        open_declared([toml], ModelStore(tmp_path), "cpu").look(image, lambda _image: (LEFT,), LABELS)


def test_only_sure_people_are_read() -> None:
    rtmdet = answers_of("rtmdet-ins", 320, 320)
    np.testing.assert_allclose(
        read_rtmdet(rtmdet["dets"], rtmdet["labels"], rtmdet["masks"], 0.3, 0).scores, [0.9, 0.8]
    )
    queries = answers_of("mask2former", 320, 80)
    found = read_mask2former(queries["class_queries_logits"], queries["masks_queries_logits"], 0.3, 0)
    np.testing.assert_allclose(found.scores, [0.9, 0.8], atol=1e-3)
    yolo = answers_of("yolo-seg", 320, 80)
    dogs = read_yolo_seg(yolo["output0"], yolo["output1"], (320, 320), 0.3, 16, 0.6)
    np.testing.assert_allclose(dogs.scores, [0.95])


def test_masks_are_cut_to_what_is_in_them() -> None:
    plane = np.zeros((30, 40), np.uint8)
    assert cropped(plane) is None
    plane[5:9, 7:20] = 200
    mask = cropped(plane)
    assert mask is not None
    assert (mask.top, mask.left, mask.values.shape) == (5, 7, (4, 13))
