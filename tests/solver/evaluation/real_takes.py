"""Takes of box people who stand in front of a camera, and truth files about them."""

import json
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from core_solver import cli
from core_solver.body import JOINT_NAMES
from core_solver.take import CameraModel, Ground, Meta, Person, Scene, Take
from tests.solver.body.synthetic import make_stick_body

CAMERA = CameraModel(1280, 720, 900.0, 900.0, 640.0, 360.0)
HEIGHT = 1.7  # of the box person
LIMBS = tuple(
    f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
)


def standing_take(
    people: int = 3, frames: int = 24, *, first_frame: int = 0, step: int = 1, rate: int = 30, seed: int = 0,
    size: float = 1.0,
) -> Take:  # fmt: skip
    """People side by side, each farther away than the last, who wave their limbs and sway."""
    rng = np.random.default_rng(seed)
    body = make_stick_body()
    rest, betas = body.rest_joints(np.zeros(10)), np.zeros(10, np.float32)
    strongest = np.argsort(-body.weights, axis=1, kind="stable")[:, :4]
    weights = np.take_along_axis(body.weights, strongest, axis=1)
    crowd = []
    for index in range(people):
        theta = rng.normal(size=(1, 24, 3)) * 0.2 + np.cumsum(rng.normal(size=(frames, 24, 3)) * 0.02, axis=0)
        theta[:, 0] += (np.pi, 0, 0)  # upright in a frame whose y points down
        place = np.array([1.2 * (index - (people - 1) / 2), 0.0, 4.0 + 0.8 * index])
        gamma = place + np.cumsum(rng.normal(size=(frames, 3)) * 0.01, axis=0)
        crowd.append(
            Person(
                id=index + 1, name=f"Person {index + 1}", height_m=HEIGHT * size, colour=(0.5, 0.5, 0.5),
                theta=theta.astype(np.float32), gamma=gamma.astype(np.float32), betas=betas, scale=size,
                valid=np.ones(frames, bool), confidence=np.full((frames, 24), 0.9 - 0.1 * index, np.float32),
                contacts=np.zeros((frames, 2), np.float32), rest_joints=rest.astype(np.float32),
                rest_vertices=body.rest_vertices(np.zeros(10)).astype(np.float32), faces=body.faces.astype(np.int32),
                weight_joints=strongest.astype(np.uint8), weights=weights.astype(np.float32),
            )
        )  # fmt: skip
    meta = Meta(
        frame_rate=Fraction(rate, step), first_frame=first_frame, frame_step=step, video_name="clip.mp4",
        camera=CAMERA, gravity=(0.0, 1.0, 0.0), ground=Ground((0.0, -1.0, 0.0), 1.0), body_model=body.id,
        body_licence=body.licence, depth_source="a test", preset="fast", solver_version="0",
    )  # fmt: skip
    empty = np.zeros((0, 3), np.float32)
    ones = np.ones(frames, np.float32)
    scene = Scene(empty, empty.astype(np.uint8), np.zeros((0, 0), np.float32), ones, 9 * ones)
    return Take(meta, (first_frame + step * np.arange(frames)) / rate, tuple(crowd), scene)


def joints_of(take: Take) -> np.ndarray:
    """(P, T, 24, 3) by matrices, one joint after the other: independent of the product's forward kinematics."""
    from scipy.spatial.transform import Rotation

    everybody = []
    for person in take.people:
        theta = person.theta.astype(float)
        turns = [Rotation.from_rotvec(theta[:, joint]) for joint in range(24)]
        rest = person.rest_joints.astype(float)
        points = [np.broadcast_to(rest[0], (len(theta), 3))]
        total = [turns[0]]
        for joint, parent in enumerate(take.meta.parents[1:], start=1):
            points.append(points[parent] + total[parent].apply(rest[joint] - rest[parent]))
            total.append(total[parent] * turns[joint])
        everybody.append(person.scale * np.stack(points, axis=1) + person.gamma[:, None])
    return np.array(everybody)


def limbs_of(take: Take) -> np.ndarray:
    """(P, T, 12, 3) in the order of `LIMBS`."""
    return joints_of(take)[:, :, [JOINT_NAMES.index(name) for name in LIMBS]]


def only(take: Take, *indices: int) -> Take:
    """The take with these people alone, in this order."""
    return replace(take, people=tuple(take.people[i] for i in indices))


def moved(take: Take, offset) -> Take:
    """Everybody shifted by metres (3,)."""
    people = tuple(replace(p, gamma=(p.gamma + np.asarray(offset)).astype(np.float32)) for p in take.people)
    return replace(take, people=people)


def evaluate(capsys, *arguments) -> tuple[int, str, str]:
    """Run `evaluate` with these arguments."""
    code = cli.main(["evaluate", *(str(a) for a in arguments)])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def rows_of(capsys, *arguments) -> list[dict]:
    """The rows that `evaluate ... --json` prints."""
    code, out, err = evaluate(capsys, *arguments, "--json")
    assert code == 0, err
    return json.loads(out)["rows"]


def refusal(capsys, *arguments) -> str:
    """The one line with which `evaluate` refuses."""
    code, out, err = evaluate(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    return err


def empty_images(directory: Path, count: int) -> None:
    """The dataset's pictures are not read; their names are part of the layout."""
    for frame in range(count):
        (directory / f"img_{frame:06d}.jpg").touch()
