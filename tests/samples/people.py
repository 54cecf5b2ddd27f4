"""The sample take: two people walk up to each other and shake hands while a child climbs two steps."""

from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from core_solver.body.kinematics import pose_joints
from core_solver.body.skeleton import joint_index
from core_solver.evaluation.synthetic.path import Move, Script, root_path
from core_solver.evaluation.synthetic.perform import Performance, perform
from core_solver.evaluation.synthetic.physique import SIDES, Physique
from core_solver.evaluation.synthetic.steps import Step, plan_steps
from core_solver.evaluation.synthetic.world import Block, Terrain, View, look
from core_solver.geometry import matrix_from_rotvec, rotvec_from_matrix
from core_solver.take import CameraModel, Ground, Meta, Person, Scene, Take
from tests.samples.figure import STATURE, Build, Figure, build_figure

Array = NDArray[np.float64]

FRAMES = 120
RATE = Fraction(30)
VIDEO = "sample_take.mp4"
TERRAIN = Terrain(
    blocks=(
        Block(centre=(1.62, 5.6), size=(0.5, 1.0), yaw=0.0, top=0.16),
        Block(centre=(2.47, 5.6), size=(1.2, 1.0), yaw=0.0, top=0.32),
        Block(centre=(0.0, 8.2), size=(12.0, 0.4), yaw=0.0, top=2.4),
    )
)
CAMERA = CameraModel(640, 360, 560.0, 560.0, 320.0, 180.0, source="made up")
VIEW = look((0.0, 0.0, 1.75), (0.25, 5.0, 0.75), roll=0.0)
TIMES = np.arange(FRAMES) / float(RATE)

_MEETING = (0.0, 4.6)
_APART = 0.74  # metres between the pelvises of those who shake hands
_HANDS_AT = 1.1  # metres above the ground
_HAND_THICKNESS = 0.034  # metres from one hand joint to the other: the two hands side by side
_REACHED, _LET_GO = (1.75, 2.15), (3.25, 3.65)  # seconds between which the hand goes out and comes back


@dataclass(frozen=True)
class Part:
    """Somebody and what they do.

    Attributes:
        id: of the person.
        name: of the person.
        height: stature, metres.
        colour: red, green, blue in [0, 1].
        script: path over the ground.
        shakes: whether the right hand goes to the meeting's middle.
    """

    id: int
    name: str
    height: float
    colour: tuple[float, float, float]
    script: Script
    shakes: bool = False


_WALK_S = 1.9
PARTS = (
    Part(1, "Ada", 1.78, (0.90, 0.35, 0.25), Script((-2.02, _MEETING[1]), 0.0, (Move(_WALK_S, 0.87),)), shakes=True),
    Part(2, "Ben", 1.66, (0.25, 0.55, 0.90), Script((2.02, _MEETING[1]), np.pi, (Move(_WALK_S, 0.87),)), shakes=True),
    Part(3, "Cleo", 1.22, (0.35, 0.75, 0.35), Script((0.45, 5.6), 0.0, (Move(3.2, 0.6),))),
)


def make_take() -> Take:
    """The sample take."""
    figure = build_figure(Build())
    people = tuple(_person(part, figure, np.random.default_rng(part.id)) for part in PARTS)
    up = VIEW.up
    triple = (float(up[0]), float(up[1]), float(up[2]))
    meta = Meta(
        frame_rate=RATE,
        first_frame=0,
        frame_step=1,
        video_name=VIDEO,
        camera=CAMERA,
        gravity=(-triple[0], -triple[1], -triple[2]),
        ground=Ground(triple, float(VIEW.position[2])),
        body_model="sample-figure",
        body_licence="CC0-1.0",
        depth_source="made up",
        preset="none",
        solver_version="0.1.0",
    )
    return Take(meta, TIMES, people, _scene())


def _person(part: Part, figure: Figure, rng: np.random.Generator) -> Person:
    physique = _physique(part, figure)
    acted = perform(part.script, physique, TERRAIN, TIMES, rng)
    path = root_path(part.script, float(TIMES[-1]))
    steps = plan_steps(path, physique, TERRAIN)[1]
    if part.shakes:
        acted = _stand_at(acted, path.position[-1], part)
        acted = _shake_hands(acted, physique, part.script.heading)
    rotations = acted.rotations.copy()
    rotations[:, 0] = VIEW.rotation @ rotations[:, 0]
    shift = VIEW.to_camera(acted.pelvis) - physique.scale * figure.joints[0]
    return Person(
        id=part.id,
        name=part.name,
        height_m=part.height,
        colour=part.colour,
        theta=rotvec_from_matrix(rotations).astype(np.float32),
        gamma=shift.astype(np.float32),
        betas=np.zeros(10, np.float32),
        scale=float(np.float32(physique.scale)),
        valid=np.ones(FRAMES, bool),
        confidence=np.ones((FRAMES, 24), np.float32),
        contacts=_contacts(steps).astype(np.float32),
        rest_joints=figure.joints.astype(np.float32),
        rest_vertices=figure.vertices.astype(np.float32),
        faces=figure.faces,
        weight_joints=figure.weight_joints,
        weights=figure.weights.astype(np.float32),
    )


def _physique(part: Part, figure: Figure) -> Physique:
    scale = part.height / STATURE
    ankles = scale * figure.joints[[joint_index(f"{side}_ankle") for side in SIDES]]
    return Physique(
        betas=np.zeros(10),
        scale=scale,
        height=part.height,
        joints=scale * figure.joints,
        keypoints=np.zeros((25, 3)),
        ankle_height=ankles[:, 1],
        heel=ankles[:, 2] + scale * 0.085,
        toe=scale * 0.18 - ankles[:, 2],
    )


def _contacts(steps: list[Step]) -> Array:
    """(T, 2) 1 while a foot carries weight, 0 while it is in the air."""
    contacts = np.ones((FRAMES, 2))
    for step in steps:
        contacts[(step.lift < TIMES) & (step.land > TIMES), step.side] = 0
    return contacts


def _stand_at(acted: Performance, end: Array, part: Part) -> Performance:
    """Move a performance over the ground so that its path ends where its part of the handshake stands."""
    side = -1.0 if part.script.heading == 0 else 1.0
    wanted = np.array([_MEETING[0] + side * _APART / 2, _MEETING[1]])
    return replace(acted, pelvis=acted.pelvis + np.append(wanted - end, 0.0))


def _shake_hands(acted: Performance, person: Physique, heading: float) -> Performance:
    """Lead the right hand to the meeting's middle, the palm to the left, and shake it there."""
    theta = rotvec_from_matrix(acted.rotations)
    turns, places = pose_joints(theta, person.joints - person.joints[0])
    front = np.array([np.cos(heading), np.sin(heading), 0.0])
    left = np.array([-front[1], front[0], 0.0])
    shaken = 0.035 * np.sin(2 * np.pi * 2.0 * (TIMES - _REACHED[1])) * _share((_REACHED[1], 2.4), (3.0, _LET_GO[0]))
    hand = np.array([*_MEETING, _HANDS_AT]) - left * _HAND_THICKNESS / 2 + shaken[:, None] * [0, 0, 1]
    # In the rest pose the right hand's fingers point along -x, its palm along -y, its thumb along +z.
    palm = np.stack([-front, -left, np.cross(front, left)], axis=1)
    wrist = hand - palm @ person.bone("right_hand", "right_wrist")
    shoulder = places[:, joint_index("right_shoulder")] + acted.pelvis
    upper, fore = _arm(wrist - shoulder, left, palm, person)
    chain = {"right_collar": turns[:, joint_index("right_collar")], "right_shoulder": upper, "right_elbow": fore}
    chain["right_wrist"] = np.broadcast_to(palm, upper.shape)
    rotations, names = acted.rotations.copy(), list(chain)
    share = _share(_REACHED, _LET_GO)[:, None]
    for parent, name in pairwise(names):
        own, wanted = rotations[:, joint_index(name)], np.swapaxes(chain[parent], 1, 2) @ chain[name]
        between = rotvec_from_matrix(np.swapaxes(own, 1, 2) @ wanted)
        rotations[:, joint_index(name)] = own @ matrix_from_rotvec(share * between)
    return replace(acted, rotations=rotations)


def _arm(reach: Array, left: Array, palm: Array, person: Physique) -> tuple[Array, Array]:
    """World rotations (T, 3, 3) of upper arm and forearm that put the wrist (T, 3) from the shoulder, elbow down."""
    a = np.linalg.norm(person.bone("right_elbow", "right_shoulder"))
    b = np.linalg.norm(person.bone("right_wrist", "right_elbow"))
    distance = np.minimum(np.linalg.norm(reach, axis=1), 0.995 * (a + b))
    direction = reach / np.linalg.norm(reach, axis=1, keepdims=True)
    pole = np.array([0.0, 0.0, -1.0]) - 0.6 * left
    pole = pole - (direction @ pole)[:, None] * direction
    pole /= np.linalg.norm(pole, axis=1, keepdims=True)
    along = (a**2 - b**2 + distance**2) / (2 * distance)
    out = np.sqrt(np.maximum(a**2 - along**2, 0))
    elbow = along[:, None] * direction + out[:, None] * pole
    wrist = distance[:, None] * direction
    hinge = np.cross(elbow, wrist - elbow)
    # The forearm twists half of the way to the hand, as forearms do.
    half_way = hinge / np.linalg.norm(hinge, axis=1, keepdims=True) + palm[:, 1]
    upper = _frame(elbow, hinge) @ _frame(person.bone("right_elbow", "right_shoulder")[None], np.eye(3)[1:2])[0].T
    fore = (
        _frame(wrist - elbow, half_way) @ _frame(person.bone("right_wrist", "right_elbow")[None], np.eye(3)[1:2])[0].T
    )
    return upper, fore


def _frame(direction: Array, second: Array) -> Array:
    """(T, 3, 3) right-handed axes as columns: along `direction`, and as near to `second` as possible."""
    first = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    second = second - np.sum(second * first, axis=1, keepdims=True) * first
    second = second / np.linalg.norm(second, axis=1, keepdims=True)
    return np.stack([first, second, np.cross(first, second)], axis=2)


def _share(rise: tuple[float, float], fall: tuple[float, float]) -> Array:
    """(T,) 0, smoothly up to 1 during `rise`, and down to 0 during `fall`."""

    def smooth(u: Array) -> Array:
        u = np.clip(u, 0, 1)
        return u**3 * (10 - 15 * u + 6 * u**2)

    up, down = (TIMES - rise[0]) / (rise[1] - rise[0]), (TIMES - fall[0]) / (fall[1] - fall[0])
    return smooth(up) * (1 - smooth(down))


def _scene() -> Scene:
    """What the camera sees of floor, steps and wall, as points."""
    step = 4
    columns, rows = np.meshgrid(np.arange(step / 2, CAMERA.width, step), np.arange(step / 2, CAMERA.height, step))
    depth, points, colours = see(columns, rows)
    near = depth < 30
    return Scene(
        points=points[near].astype(np.float32),
        colors=colours[near],
        depth=np.where(near, depth, np.nan).astype(np.float32),
        z_near=np.full(FRAMES, 1.0, np.float32),
        z_far=np.full(FRAMES, 12.0, np.float32),
    )


def see(columns: Array, rows: Array) -> tuple[Array, Array, NDArray[np.uint8]]:
    """Depth (...), camera points (..., 3) and colours (..., 3) of the empty scene at pixels (...)."""
    rays = np.stack([(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones_like(columns)], axis=-1)
    depth = TERRAIN.depth(VIEW.position, rays @ VIEW.rotation)
    points = np.where(np.isfinite(depth), depth, 100.0)[..., None] * rays
    return depth, points, _paint(VIEW, points, depth)


def _paint(view: View, points: Array, depth: Array) -> NDArray[np.uint8]:
    """A chequered floor, wooden steps, a wall that darkens towards the floor, and sky."""
    world = view.to_world(points)
    x, y, z = np.moveaxis(world, -1, 0)
    dark = (np.floor(2 * x) + np.floor(2 * y)) % 2 > 0
    floor = np.where(dark[..., None], [96, 100, 108], [186, 188, 184])
    riser = (np.abs((10 * x) % 1 - 0.5) > 0.42) & (z < 0.33)
    wood = np.where(riser[..., None], [120, 84, 56], [176, 132, 92])
    wall = np.array([150, 160, 176]) * (0.75 + 0.1 * np.clip(z, 0, 2.5))[..., None]
    colour = np.where(((z > 0.02) & (y < 7.5))[..., None], wood, np.where((y > 7.9)[..., None], wall, floor))
    return np.where(np.isfinite(depth)[..., None], colour, [205, 220, 235]).clip(0, 255).astype(np.uint8)
