"""Tiny scenes in the benchmark's types, made of the box people that the solver's own tests use."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from core_solver.body.model import BodyModel
from core_solver.evaluation import worker
from core_solver.evaluation.processes import Job
from core_solver.evaluation.truth import SyntheticScene, Truth
from core_solver.geometry import GroundFrame
from core_solver.optimise.posing import sole_rows
from core_solver.optimise.solution import Solution
from tests.solver.body.synthetic import make_stick_body
from tests.solver.scenes import SyntheticClip, Walker, make_clip


@dataclass(frozen=True)
class Floor:
    """A plane `below` metres under the camera."""

    up: np.ndarray
    below: float

    def height_above(self, points):
        return points @ self.up + self.below


@dataclass(frozen=True)
class FakeScene:
    """A scene and the solution that is right."""

    scene: SyntheticScene
    solution: Solution


def make_fake(name: str = "couple", frames: int = 12, seed: int = 0, body: BodyModel | None = None) -> FakeScene:
    """An adult and a smaller person on one floor."""
    body = body or make_stick_body()
    walkers = [Walker(1.0, (-1, 5), 0.5), Walker(0.85, (1, 6), -1.0)]
    clip = make_clip(body, walkers, frames=frames, seed=seed)
    soles = clip.vertices[:, :, body.proxy][:, :, sole_rows(body)]
    floor = Floor(clip.up, clip.camera_height)
    contacts = (floor.height_above(soles) < 0.02).any(axis=-1)
    betas = np.tile(body.neutral_betas, (2, 1))
    heights = np.array([s * body.height(b) for s, b in zip(clip.scales, betas, strict=True)])
    truth = Truth(
        joints=clip.joints, soles=soles, present=np.ones((2, frames), bool), contacts=contacts, heights=heights,
        up=clip.up, scenery=floor,
    )  # fmt: skip
    scene = SyntheticScene(name, body, clip.camera, clip.modalities, truth)
    return FakeScene(scene, true_solution(clip, contacts, betas))


def true_solution(clip: SyntheticClip, contacts: np.ndarray, betas: np.ndarray) -> Solution:
    people, frames = clip.gamma.shape[:2]
    return Solution(
        theta=clip.theta, gamma=clip.gamma, betas=betas, scales=clip.scales, confidence=np.ones((people, frames, 24)),
        contacts=contacts.astype(float), inverse_far=np.full(frames, 0.01), inverse_gap=np.full(frames, 1.0),
        ground=GroundFrame(-clip.up, clip.up, clip.camera_height),
    )  # fmt: skip


class _Ended:
    """A process that has run to its end."""

    def poll(self) -> int:
        return 0


def start_here(job: Job) -> _Ended:
    """Instead of `Job.start`: the worker's own code, but in this process, which saves seconds of imports."""
    try:
        worker.main([str(job.problem), str(job.outcome), job.case.preset, *job.case.left_out])
    except ValueError as error:
        job.outcome.with_suffix(".log").write_text(f"Traceback\nValueError: {error}\n")
    return _Ended()


def good_and_broken(seed: int) -> Iterator[SyntheticScene]:
    """The second scene has nobody in it: its solve fails."""
    good = make_fake("good", seed=seed).scene
    yield good
    yield replace(good, name="broken", modalities=replace(good.modalities, tracks=()))


def tiny_suite(seed: int) -> Iterator[SyntheticScene]:
    """Two scenes, generated one after the other."""
    for name in ("first", "second"):
        yield make_fake(name, seed=seed).scene
