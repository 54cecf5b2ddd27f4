"""What a take says about each person, frame by frame: where the body is, how its feet stand, how sure the solver was.

World frame: metres, z up, origin on the ground below the camera (`geometry.world_from_camera`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.body import pose_joints
from core_solver.geometry import GroundFrame, Similarity, quaternion_from_matrix, world_from_camera
from core_solver.preview.bodies import PosablePerson
from core_solver.take import Person, Take

Array = NDArray[np.float64]

RESTING = 0.5  # a foot whose contact is more probable than this is meant to stand still
_FEET = (("left_ankle", "left_foot"), ("right_ankle", "right_foot"))
_SOLE_THICKNESS = 0.02  # metres above a foot's lowest rest vertex, before scale
_MILLIMETRES = 1000.0


@dataclass(frozen=True)
class PersonMeasures:
    """One person over T frames, in the world.

    Attributes:
        joints: (T, 24, 3) metres.
        turns: (T, 24, 4) unit quaternions (w, x, y, z), from the rest pose to the posed body in the world.
        top: (T,) metres of the body's highest point above the ground.
        lowest: (T,) metres of its lowest point above the ground, negative inside it.
        confidence: (T,) mean over the joints, in [0, 1].
        skate: (T, 2) millimetres that the left and the right sole moved along the ground since the frame before, NaN
            where the foot does not rest in both frames.
    """

    joints: Array
    turns: Array
    top: Array
    lowest: Array
    confidence: Array
    skate: Array


def ground_frame(take: Take) -> GroundFrame:
    """Gravity and ground of a take."""
    meta = take.meta
    return GroundFrame(np.array(meta.gravity), np.array(meta.ground.normal), meta.ground.offset)


def measure_person(person: Person, joint_names: tuple[str, ...], ground: GroundFrame) -> PersonMeasures:
    """Pose one person in every frame and measure the body."""
    to_world = world_from_camera(ground)
    posable = PosablePerson(person)
    soles = [_sole_vertices(person, [joint_names.index(name) for name in foot]) for foot in _FEET]
    frames = len(person.theta)
    top, lowest = np.zeros(frames), np.zeros(frames)
    treads = [np.zeros((frames, len(rows), 3)) for rows in soles]
    for frame in range(frames):
        vertices = posable.vertices(frame)
        heights = ground.height_above(vertices)
        if heights.size:  # a person without a skin has joints only
            top[frame], lowest[frame] = heights.max(), heights.min()
        for tread, rows in zip(treads, soles, strict=True):
            tread[frame] = to_world.apply(vertices[rows])
    steps = np.stack([_steps_along_ground(tread) for tread in treads], axis=-1)
    return PersonMeasures(
        joints=to_world.apply(posable.joints()),
        turns=_turns(person, to_world),
        top=top,
        lowest=lowest,
        confidence=person.confidence.mean(axis=1, dtype=float),
        skate=np.where(resting_steps(person.contacts), steps, np.nan),
    )


def resting_steps(contacts: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(T, 2) whether a foot rests both in this frame and in the one before; never in the first."""
    rests = contacts > RESTING
    both = np.zeros_like(rests)
    both[1:] = rests[1:] & rests[:-1]
    return both


def _turns(person: Person, to_world: Similarity) -> Array:
    rotations = pose_joints(person.theta, person.rest_joints)[0]
    return quaternion_from_matrix(to_world.rotation @ rotations)


def _sole_vertices(person: Person, joints: list[int]) -> NDArray[np.int64]:
    """The vertices under a foot: of those it carries, the lowest of the rest pose, whose y axis points up."""
    carried = np.where(np.isin(person.weight_joints, joints), person.weights, 0).sum(axis=1) > RESTING
    rows = np.flatnonzero(carried)
    if rows.size == 0:
        return rows
    heights = person.rest_vertices[rows, 1]
    return rows[heights <= heights.min() + _SOLE_THICKNESS]


def _steps_along_ground(tread: Array) -> Array:
    """(T,) millimetres that (T, S, 3) points moved horizontally since the frame before, on average; 0 at first."""
    steps = np.zeros(len(tread))
    if tread.shape[1]:
        steps[1:] = _MILLIMETRES * np.linalg.norm(np.diff(tread[..., :2], axis=0), axis=-1).mean(axis=1)
    return steps
