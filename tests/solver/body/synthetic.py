"""A whole `BodyModel` made of 24 boxes, for tests that must run without fetched models.

A person 1.70 m tall in a T-pose. Every box is watertight and belongs to one joint; its end towards the parent is shared
half and half, so that skinning really blends. Joints and keypoints are trilinear combinations of a box's corners.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.body import JOINT_NAMES, KEYPOINT_NAMES, PARENTS, BodyModel

Array = NDArray[np.float64]

# Heights above the floor and positions of the left side; x to the left, z to the front, metres.
_JOINTS = {
    "pelvis": (0, 0.93, 0), "spine1": (0, 1.03, -0.02), "spine2": (0, 1.14, -0.01), "spine3": (0, 1.22, 0),
    "neck": (0, 1.42, -0.02), "head": (0, 1.50, 0.01), "left_hip": (0.09, 0.86, 0), "left_knee": (0.10, 0.47, 0),
    "left_ankle": (0.10, 0.08, -0.03), "left_foot": (0.10, 0.03, 0.09), "left_collar": (0.07, 1.34, -0.01),
    "left_shoulder": (0.18, 1.38, -0.02), "left_elbow": (0.44, 1.37, -0.03), "left_wrist": (0.69, 1.37, -0.03),
    "left_hand": (0.77, 1.37, -0.03),
}  # fmt: skip

# Each joint's box: low corner, high corner, axis along which it is cut into rings, number of rings, whether that axis
# runs towards the parent (so that the shared end is the last ring instead of the first).
_BOXES = {
    "pelvis": ((-0.15, 0.86, -0.10), (0.15, 1.02, 0.10), 1, 4, True),
    "spine1": ((-0.13, 1.02, -0.09), (0.13, 1.13, 0.09), 1, 4, False),
    "spine2": ((-0.14, 1.13, -0.09), (0.14, 1.21, 0.09), 1, 4, False),
    "spine3": ((-0.16, 1.21, -0.10), (0.16, 1.41, 0.10), 1, 5, False),
    "neck": ((-0.05, 1.41, -0.06), (0.05, 1.49, 0.05), 1, 3, False),
    "head": ((-0.08, 1.49, -0.09), (0.08, 1.70, 0.11), 1, 6, False),
    "left_hip": ((0.02, 0.48, -0.08), (0.16, 0.88, 0.08), 1, 8, True),
    "left_knee": ((0.05, 0.10, -0.06), (0.15, 0.48, 0.06), 1, 8, True),
    "left_ankle": ((0.06, 0.00, -0.08), (0.14, 0.10, 0.07), 2, 6, False),
    "left_foot": ((0.06, 0.00, 0.07), (0.14, 0.05, 0.17), 2, 6, False),
    "left_collar": ((0.05, 1.30, -0.06), (0.16, 1.42, 0.05), 0, 3, False),
    "left_shoulder": ((0.16, 1.32, -0.07), (0.44, 1.43, 0.03), 0, 7, False),
    "left_elbow": ((0.43, 1.33, -0.07), (0.69, 1.41, 0.01), 0, 7, False),
    "left_wrist": ((0.68, 1.35, -0.07), (0.77, 1.39, 0.01), 0, 4, False),
    "left_hand": ((0.76, 1.35, -0.07), (0.87, 1.39, 0.01), 0, 5, False),
}  # fmt: skip

# Each keypoint's box and place in it.
_KEYPOINTS = {
    "nose": ("head", (0, 1.57, 0.11)), "left_eye": ("head", (0.03, 1.60, 0.10)), "left_ear": ("head", (0.08, 1.58, 0)),
    "left_shoulder": ("left_shoulder", (0.18, 1.38, -0.02)), "left_elbow": ("left_elbow", (0.44, 1.37, -0.03)),
    "left_wrist": ("left_wrist", (0.69, 1.37, -0.03)), "left_hip": ("left_hip", (0.09, 0.86, 0)),
    "left_knee": ("left_knee", (0.10, 0.47, 0)), "left_ankle": ("left_ankle", (0.10, 0.08, -0.03)),
    "left_heel": ("left_ankle", (0.10, 0.02, -0.08)), "left_toe": ("left_foot", (0.08, 0.02, 0.17)),
    "left_index": ("left_hand", (0.78, 1.37, 0.0)), "left_pinky": ("left_hand", (0.77, 1.37, -0.06)),
}  # fmt: skip

_PELVIS = np.array([0.0, -0.20, 0.02])  # off the origin on purpose: code that forgets the root's rest place must fail


@dataclass(frozen=True)
class _Box:
    """One bone's surface: vertices (4 * rings, 3), faces (n, 3), and how much of each vertex belongs to the parent."""

    vertices: Array
    faces: NDArray[np.int32]
    parent_share: Array
    corners: NDArray[np.int32]


def make_stick_body() -> BodyModel:
    """The body described above: V = 536 vertices, F = 976 faces, proxy of 336."""
    boxes = [_make_box(*_side(JOINT_NAMES[joint], _BOXES)) for joint in range(24)]
    starts = np.cumsum([0] + [len(box.vertices) for box in boxes])
    template = np.concatenate([box.vertices for box in boxes])
    owner = np.repeat(np.arange(24), [len(box.vertices) for box in boxes])
    joints = {name: (name, _placed(name, _JOINTS)) for name in JOINT_NAMES}
    keypoints = {name: _keypoint_place(name) for name in KEYPOINT_NAMES}
    offset = _PELVIS - np.array(_JOINTS["pelvis"])
    return BodyModel(
        id="stick-body-1",
        licence="CC0-1.0",
        template=template + offset,
        shape_directions=_shape_directions(template, owner),
        pose_directions=None,
        joint_regressor=np.stack([_trilinear(*joints[name], boxes, starts) for name in JOINT_NAMES]),
        weights=_weights(boxes),
        faces=np.concatenate([box.faces + start for box, start in zip(boxes, starts, strict=False)]).astype(np.int32),
        keypoint_regressor=np.stack([_trilinear(*keypoints[name], boxes, starts) for name in KEYPOINT_NAMES]),
        neutral_betas=np.zeros(10),
        proxy=_proxy(template, owner),
    )


def _mirrored(values: tuple[float, float, float]) -> tuple[float, float, float]:
    return -values[0], values[1], values[2]


def _placed(name: str, table: dict[str, tuple[float, float, float]]) -> Array:
    if name.startswith("right_"):
        return np.array(_mirrored(table["left_" + name.removeprefix("right_")]), float)
    return np.array(table[name], float)


def _keypoint_place(name: str) -> tuple[str, Array]:
    if not name.startswith("right_"):
        box, place = _KEYPOINTS[name]
        return box, np.array(place, float)
    box, place = _KEYPOINTS["left_" + name.removeprefix("right_")]
    return box.replace("left_", "right_"), np.array(_mirrored(place), float)


def _side(name: str, table: dict[str, tuple]) -> tuple[Array, Array, int, int, bool]:
    """A joint's box; the right side's is the left one seen in the mirror."""
    low, high, axis, rings, reverse = table[name.replace("right_", "left_")]
    low, high = np.array(low, float), np.array(high, float)
    if name.startswith("right_"):
        low[0], high[0] = -high[0], -low[0]
        reverse = not reverse if axis == 0 else reverse
    return low, high, axis, rings, reverse


def _make_box(low: Array, high: Array, axis: int, rings: int, reverse: bool) -> _Box:
    u, v = (axis + 1) % 3, (axis + 2) % 3
    vertices = np.empty((rings, 4, 3))
    vertices[..., axis] = np.linspace(low[axis], high[axis], rings)[:, None]
    vertices[..., u] = np.array([low[u], high[u], high[u], low[u]])
    vertices[..., v] = np.array([low[v], low[v], high[v], high[v]])
    share = np.zeros((rings, 4))
    share[-1 if reverse else 0] = 0.5
    last = 4 * (rings - 1)
    faces = [(0, 2, 1), (0, 3, 2), (last, last + 1, last + 2), (last, last + 2, last + 3)]
    for start in range(0, last, 4):
        for k in range(4):
            a, b = start + k, start + (k + 1) % 4
            faces += [(a, b, b + 4), (a, b + 4, a + 4)]
    corners = np.array([0, 1, 2, 3, last, last + 1, last + 2, last + 3], np.int32)
    return _Box(vertices.reshape(-1, 3), np.array(faces, np.int32), share.ravel(), corners)


def _trilinear(joint: str, place: Array, boxes: list[_Box], starts: NDArray[np.int_]) -> Array:
    """The row (V,) over the 8 corners of the joint's box that gives `place`, which must lie inside the box."""
    box = boxes[JOINT_NAMES.index(joint)]
    corners = box.vertices[box.corners]
    low, high = corners.min(axis=0), corners.max(axis=0)
    fraction = (place - low) / (high - low)
    assert (abs(fraction - 0.5) < 0.5 + 1e-9).all(), (joint, place)
    row = np.zeros(starts[-1])
    at_high = corners > (low + high) / 2
    row[starts[JOINT_NAMES.index(joint)] + box.corners] = np.where(at_high, fraction, 1 - fraction).prod(axis=1)
    return np.maximum(row, 0)


def _weights(boxes: list[_Box]) -> Array:
    blocks = []
    for joint, box in enumerate(boxes):
        block = np.zeros((len(box.vertices), 24))
        block[:, joint] = 1 - box.parent_share
        block[:, max(PARENTS[joint], 0)] += box.parent_share
        blocks.append(block)
    return np.concatenate(blocks)


def _shape_directions(template: Array, owner: NDArray[np.int_]) -> Array:
    """Ten independent ways to differ (V, 3, 10), each a few centimetres per unit; `template` stands on y = 0."""
    x, y, z = template.T
    head = owner == JOINT_NAMES.index("head")
    feet = np.isin(owner, [JOINT_NAMES.index("left_foot"), JOINT_NAMES.index("right_foot")])
    none = np.zeros_like(x)
    fields = [
        (0.06 * x, 0.06 * (y - 0.93), 0.06 * z),  # stature
        (0.04 * np.clip(x, -0.16, 0.16), none, 0.08 * z),  # girth
        (none, 0.03 * np.minimum(y - 0.86, 0), none),  # legs
        (0.03 * np.sign(x) * np.maximum(np.abs(x) - 0.16, 0), none, none),  # arms
        (none, 0.03 * np.maximum(y - 1.02, 0), none),  # torso and neck
        (none, 0.20 * np.where(head, y - 1.49, 0), none),  # head
        (0.02 * np.sign(x) * np.clip((np.abs(x) - 0.05) / 0.11, 0, 1) * (y > 1.25), none, none),  # shoulders
        (0.015 * np.sign(x) * (np.abs(x) > 0.01) * (y < 0.90), none, none),  # stance
        (none, none, np.where(feet, 0.2 * (z - 0.07), 0)),  # feet
        (none, none, 0.1 * np.maximum(z, 0) * (y > 0.9) * (y < 1.3)),  # belly
    ]
    return np.stack([np.stack(field, axis=1) for field in fields], axis=-1)


def _proxy(template: Array, owner: NDArray[np.int_]) -> NDArray[np.int32]:
    """Every vertex of feet and hands (soles: 24 a foot) and every other one elsewhere."""
    ends = [JOINT_NAMES.index(f"{side}_{part}") for side in ("left", "right") for part in ("ankle", "foot", "hand")]
    kept = np.isin(owner, ends) | (np.arange(len(template)) % 2 == 0)
    return np.flatnonzero(kept).astype(np.int32)
