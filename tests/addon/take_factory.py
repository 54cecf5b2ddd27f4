"""Synthetic takes with exact truth, numpy only: people of boxes that move smoothly before a tilted camera."""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from core_solver.geometry import matrix_from_rotvec
from core_solver.take import JOINT_NAMES, PARENTS, CameraModel, Ground, Meta, Person, Scene, Take

# Metres from the parent, SMPL axes: y up, z to the front, x to the body's left.
_STEPS = {
    "pelvis": (0.0, -0.22, 0.03), "left_hip": (0.06, -0.09, 0.0), "right_hip": (-0.06, -0.09, 0.0),
    "spine1": (0.0, 0.11, -0.02), "left_knee": (0.04, -0.38, 0.0), "right_knee": (-0.04, -0.38, 0.0),
    "spine2": (0.0, 0.13, 0.02), "left_ankle": (0.0, -0.4, -0.03), "right_ankle": (0.0, -0.4, -0.03),
    "spine3": (0.0, 0.05, 0.0), "left_foot": (0.0, -0.06, 0.12), "right_foot": (0.0, -0.06, 0.12),
    "neck": (0.0, 0.21, -0.02), "left_collar": (0.07, 0.12, 0.0), "right_collar": (-0.07, 0.12, 0.0),
    "head": (0.0, 0.09, 0.05), "left_shoulder": (0.12, 0.03, 0.0), "right_shoulder": (-0.12, 0.03, 0.0),
    "left_elbow": (0.26, -0.01, 0.0), "right_elbow": (-0.26, -0.01, 0.0), "left_wrist": (0.25, 0.0, 0.0),
    "right_wrist": (-0.25, 0.0, 0.0), "left_hand": (0.08, 0.0, 0.0), "right_hand": (-0.08, 0.0, 0.0),
}  # fmt: skip
_COLOURS = ((0.9, 0.3, 0.2), (0.2, 0.5, 0.9), (0.3, 0.8, 0.3), (0.9, 0.8, 0.2))
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_BOX_FACES = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
])  # fmt: skip


@dataclass(frozen=True)
class TakeSpec:
    """What to make; the defaults are landscape HD, off-centre principal point, square pixels."""

    people: int = 2
    frames: int = 12
    width: int = 1280
    height: int = 720
    fx: float = 900.0
    fy: float = 900.0
    cx: float = 655.5
    cy: float = 341.25
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    rate: Fraction = Fraction(30000, 1001)
    first_frame: int = 0
    frame_step: int = 1
    swing: float = 0.6
    points: int = 4000
    absence: int = 0
    """Frames in which a person has not come yet (the first, third, ...) or has left (the others), standing still."""
    vertices: int = 0
    """0 for bodies of boxes, otherwise skins of so many vertices with four different joints at each."""
    seed: int = 0


def make_take(spec: TakeSpec) -> Take:
    rng = np.random.default_rng(spec.seed)
    tilt = matrix_from_rotvec([0.35, 0.1, -0.08])
    up = tilt @ np.array([0.0, -1.0, 0.0])
    people = tuple(_person(rng, spec, index, tilt) for index in range(spec.people))
    camera = CameraModel(
        spec.width, spec.height, spec.fx, spec.fy, spec.cx, spec.cy, spec.distortion, "a synthetic camera"
    )
    meta = Meta(
        frame_rate=spec.rate,
        first_frame=spec.first_frame,
        frame_step=spec.frame_step,
        video_name="clip.y4m",
        camera=camera,
        gravity=_triple(-up),
        ground=Ground(_triple(up), 2.0),
        body_model="boxes",
        body_licence="CC0-1.0",
        depth_source="truth",
        preset="none",
        solver_version="0.1.0",
        warnings=("The depth is made up.",),
    )
    times = (spec.first_frame / spec.frame_step + np.arange(spec.frames)) / float(spec.rate)
    return Take(meta, times, people, _scene(rng, spec, up))


def person_joints(person: Person) -> np.ndarray:
    """(T, 24, 3) in the camera's frame, metres."""
    return person.scale * _bone_transforms(person)[1] + person.gamma[:, None]


def person_vertices(person: Person) -> np.ndarray:
    """(T, V, 3) by linear blend skinning, camera frame, metres."""
    rotations, joints = _bone_transforms(person)
    moved = np.zeros((len(person.theta), len(person.rest_vertices), 3))
    for slot in range(4):
        bone = person.weight_joints[:, slot]
        local = person.rest_vertices - person.rest_joints[bone]
        carried = np.einsum("tvab,vb->tva", rotations[:, bone], local) + joints[:, bone]
        moved += person.weights[:, slot, None] * carried
    return person.scale * moved + person.gamma[:, None]


def project(camera: CameraModel, points: np.ndarray) -> np.ndarray:
    """(..., 2) pixels of (..., 3) camera-frame points, without lens distortion."""
    x, y, z = np.moveaxis(points, -1, 0)
    return np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], axis=-1)


def _bone_transforms(person: Person) -> tuple[np.ndarray, np.ndarray]:
    """World rotations (T, 24, 3, 3) and positions (T, 24, 3) of the joints before scale and gamma."""
    local = matrix_from_rotvec(person.theta)
    rest = np.asarray(person.rest_joints, float)
    transforms = np.tile(np.eye(4), (len(local), 24, 1, 1))
    for joint, parent in enumerate(PARENTS):
        step = np.tile(np.eye(4), (len(local), 1, 1))
        step[:, :3, :3] = local[:, joint]
        step[:, :3, 3] = rest[joint] - (rest[parent] if parent >= 0 else 0)
        transforms[:, joint] = transforms[:, parent] @ step if parent >= 0 else step
    return transforms[..., :3, :3], transforms[..., :3, 3]


def _person(rng: np.random.Generator, spec: TakeSpec, index: int, tilt: np.ndarray) -> Person:
    rest = np.zeros((24, 3))
    for joint, (name, parent) in enumerate(zip(JOINT_NAMES, PARENTS, strict=True)):
        rest[joint] = np.array(_STEPS[name]) + (rest[parent] if parent >= 0 else 0)
    vertices, faces, weight_joints, weights = _skin(rng, rest, spec.vertices) if spec.vertices else _boxes(rest)
    scale = float(np.float32(0.75 + 0.25 * index))
    t = np.arange(spec.frames)
    phase = rng.uniform(0, 2 * np.pi, (24, 3))
    swing = spec.swing * rng.normal(size=(24, 3))
    theta = swing * np.sin(0.3 * t[:, None, None] + phase)
    # Facing the camera, standing along gravity, while turning right round: quaternions must not flip on the way.
    upright = tilt @ np.diag([1.0, -1.0, -1.0])
    for frame in t:
        turn = matrix_from_rotvec([0.0, 0.4 * frame + index, 0.0])
        theta[frame, 0] = _rotvec(upright @ turn @ matrix_from_rotvec(0.3 * theta[frame, 0]))
    hip_height = -scale * rest[:, 1].min()
    up = tilt @ np.array([0.0, -1.0, 0.0])
    ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
    start = up * (hip_height - 2.0) + ahead * (4.0 + 1.5 * index) + tilt[:, 0] * (1.2 * index - 0.6)
    gamma = start + tilt[:, 0] * 0.02 * t[:, None] + 0.05 * up * np.sin(0.5 * t)[:, None]
    valid = np.ones(spec.frames, bool)
    valid[spec.frames // 2 : spec.frames // 2 + 2] = False
    there = slice(spec.absence, None) if index % 2 == 0 else slice(None, spec.frames - spec.absence)
    valid &= np.isin(t, t[there])
    held = np.clip(t, t[there][0], t[there][-1])
    theta, gamma = theta[held], gamma[held]
    return Person(
        id=3 * index + 1,
        name=f"Person {index + 1}",
        height_m=round(scale * float(np.ptp(vertices[:, 1])), 3),
        colour=_COLOURS[index % len(_COLOURS)],
        theta=theta.astype(np.float32),
        gamma=gamma.astype(np.float32),
        betas=np.zeros(10, np.float32),
        scale=scale,
        valid=valid,
        confidence=rng.uniform(0.2, 1.0, (spec.frames, 24)).astype(np.float32),
        contacts=rng.uniform(0.0, 1.0, (spec.frames, 2)).astype(np.float32),
        rest_joints=rest.astype(np.float32),
        rest_vertices=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        weight_joints=weight_joints.astype(np.uint8),
        weights=weights.astype(np.float32),
    )


def _boxes(rest: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """One box per limb; the end at the joint's parent is shared half and half with that parent."""
    vertices, faces, joints, weights = [], [], [], []
    for joint, parent in enumerate(PARENTS[1:], start=1):
        base = 8 * len(vertices)
        middle, half = (rest[joint] + rest[parent]) / 2, np.abs(rest[joint] - rest[parent]) / 2
        corners = middle + _CORNERS * np.maximum(half, 0.035)
        nearer_child = np.linalg.norm(corners - rest[joint], axis=1) < np.linalg.norm(corners - rest[parent], axis=1)
        grand = max(PARENTS[parent], 0)
        vertices.append(corners)
        faces.append(_BOX_FACES + base)
        joints.append(np.where(nearer_child[:, None], [joint, parent, 0, 0], [parent, grand, joint, 0]))
        weights.append(np.where(nearer_child[:, None], [0.25, 0.75, 0.0, 0.0], [0.6, 0.3, 0.1, 0.0]))
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(joints), np.concatenate(weights)


def _skin(
    rng: np.random.Generator, rest: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A band of triangles around the bones; every vertex hangs on four joints by uneven weights."""
    joints = np.sort(rng.permuted(np.tile(np.arange(24), (count, 1)), axis=1)[:, :4], axis=1)
    weights = rng.dirichlet((4.0, 2.0, 1.0, 0.5), count)
    vertices = rest[joints[:, 0]] + rng.normal(scale=0.08, size=(count, 3))
    first = np.arange(count - 2)
    return vertices, np.stack([first, first + 1, first + 2], axis=1), joints, weights


def _scene(rng: np.random.Generator, spec: TakeSpec, up: np.ndarray) -> Scene:
    """A chequered floor and a coloured wall."""
    right = np.cross([0.0, 0.0, 1.0], up)
    right /= np.linalg.norm(right)
    ahead = np.cross(up, right)
    ahead *= np.sign(ahead[2])
    floor = spec.points // 2
    u, v = rng.uniform(-3, 3, floor), rng.uniform(2, 8, floor)
    points = u[:, None] * right + v[:, None] * ahead - 2.0 * up
    dark = (np.floor(u) + np.floor(v)) % 2
    colours = np.where(dark[:, None] > 0, [60, 60, 70], [200, 200, 190])
    u, v = rng.uniform(-3, 3, spec.points - floor), rng.uniform(0, 3, spec.points - floor)
    wall = u[:, None] * right + 8.0 * ahead + (v[:, None] - 2.0) * up
    paint = np.stack([128 + 40 * u, 80 * v, np.full(len(u), 90)], axis=-1)
    return Scene(
        points=np.concatenate([points, wall]).astype(np.float32),
        colors=np.concatenate([colours, paint]).clip(0, 255).astype(np.uint8),
        depth=np.zeros((0, 0), np.float32),
        z_near=np.full(spec.frames, 1.0, np.float32),
        z_far=np.full(spec.frames, 20.0, np.float32),
    )


def _rotvec(matrix: np.ndarray) -> np.ndarray:
    angle = np.arccos(np.clip((np.trace(matrix) - 1) / 2, -1, 1))
    axis = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
    return angle * axis / max(2 * np.sin(angle), 1e-9)


def _triple(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in vector)
    return x, y, z
