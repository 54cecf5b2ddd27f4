"""A solution measured against a scene's truth, and many of these summed up in one row."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from core_solver.body import BodyModel, pose_joints, skin
from core_solver.evaluation import alignment, metrics, motion
from core_solver.evaluation.truth import SyntheticScene
from core_solver.optimise.posing import sole_rows
from core_solver.optimise.solution import Solution

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Measures:
    """The numbers of a row, in the names of the results file; None where nothing could be measured.

    Attributes:
        mrpe_mm: mean root position error.
        ap25_matched: share of matched roots within 250 mm.
        ap25: average precision of roots at 250 mm.
        pck3d: joints within 150 mm, root-relative, unscaled.
        mpjpe_mm: joint error, root-relative.
        pa_mpjpe_mm: joint error after Procrustes alignment.
        jitter_paper_mm: difference of the lengths of steps, a frame.
        jitter_wham: third derivative in 10 m/s^3.
        skate_mm: motion of resting feet, a frame.
        penetration_mm: mean depth of vertices below the true scene.
        contact_f1: of feet on the ground.
        height_error: relative.
        group_w_mm: joint error after one rigid motion of all people.
        depth_order: share of pairs in right order.
        seconds: of the solve.
        peak_mb: of its process.
    """

    mrpe_mm: float | None
    ap25_matched: float | None
    ap25: float | None
    pck3d: float | None
    mpjpe_mm: float | None
    pa_mpjpe_mm: float | None
    jitter_paper_mm: float | None
    jitter_wham: float | None
    skate_mm: float | None
    penetration_mm: float | None
    contact_f1: float | None
    height_error: float | None
    group_w_mm: float | None
    depth_order: float | None
    seconds: float | None
    peak_mb: float | None


MEASURES = tuple(field.name for field in fields(Measures))


@dataclass(frozen=True)
class Details:
    """Second variants, kept for each scene.

    Attributes:
        w_mpjpe_mm: 100-frame chunks aligned on two frames, rigidly.
        w_mpjpe_scaled_mm: with scale, as in the usual code.
        wa_mpjpe_mm: chunks aligned as a whole, rigidly.
        wa_mpjpe_scaled_mm: with scale.
        group_w_scaled_mm: all people together, with scale.
        true_jitter_wham: the truth's own.
        penetration_share: of vertices below the true scene.
        own_penetration_mm: mean depth of soles below the ground the solver found itself.
    """

    w_mpjpe_mm: float | None
    w_mpjpe_scaled_mm: float | None
    wa_mpjpe_mm: float | None
    wa_mpjpe_scaled_mm: float | None
    group_w_scaled_mm: float | None
    true_jitter_wham: float | None
    penetration_share: float | None
    own_penetration_mm: float | None


@dataclass(frozen=True)
class SceneScores:
    """One solution of one scene.

    Attributes:
        scene: its name.
        measures: the row's numbers for this scene.
        details: more of them.
        root_errors_mm: for each person the root error in each frame, None where not measured.
    """

    scene: str
    measures: Measures
    details: Details
    root_errors_mm: tuple[tuple[float | None, ...], ...]


@dataclass(frozen=True)
class Row:
    """The mean of each measure over the scenes that have it.

    Attributes:
        preset: how it was solved.
        ablation: "none" or what was left out.
        seeds: whose scenes.
        measures: means.
    """

    preset: str
    ablation: str
    seeds: tuple[int, ...]
    measures: Measures

    def as_json(self) -> dict[str, object]:
        """The row of the results file."""
        numbers = {name: getattr(self.measures, name) for name in MEASURES}
        return {"preset": self.preset, "ablation": self.ablation, "seeds": list(self.seeds), **numbers}


@dataclass(frozen=True)
class PosedPeople:
    """What a solution says in points, camera frame, metres.

    Attributes:
        joints: (N, T, 24, 3).
        vertices: (N, T, P, 3) the body's proxy.
        soles: (N, T, 2, S, 3) the vertices under the left and the right foot.
        heights: (N,) statures.
    """

    joints: Array
    vertices: Array
    soles: Array
    heights: Array


def evaluate_scene(scene: SyntheticScene, solution: Solution, seconds: float, peak_mb: float) -> SceneScores:
    """Measure a solution where truth is present, frame by frame and person by person.

    A person counts as found from the first to the last frame in which the track saw them, gaps between included: that
    is when a take shows them. Before and after, they cost average precision and nothing else.
    """
    truth, people = scene.truth, pose_people(solution, scene.body)
    found = np.stack([metrics.first_to_last(track.valid) for track in scene.modalities.tracks])
    mask = truth.present & found
    roots, true_roots = people.joints[:, :, 0], truth.joints[:, :, 0]
    rate = _frame_rate(scene.modalities.times)
    measures = Measures(
        mrpe_mm=metrics.mrpe(roots, true_roots, mask),
        ap25_matched=metrics.ap25_matched(roots, true_roots, mask),
        ap25=metrics.average_precision(roots, solution.confidence.mean(axis=-1), mask, true_roots, truth.present),
        pck3d=metrics.pck3d(people.joints, truth.joints, mask),
        mpjpe_mm=metrics.mpjpe(people.joints, truth.joints, mask),
        pa_mpjpe_mm=metrics.pa_mpjpe(people.joints, truth.joints, mask),
        jitter_paper_mm=motion.jitter_paper(people.joints, truth.joints, mask),
        jitter_wham=motion.jitter_wham(people.joints, mask, rate),
        skate_mm=motion.foot_skate(people.soles, truth.contacts, mask),
        penetration_mm=motion.penetration(people.vertices, truth.scenery, mask),
        contact_f1=motion.contact_f1(solution.contacts, truth.contacts, mask),
        height_error=metrics.height_error(people.heights, truth.heights),
        group_w_mm=alignment.group_w(people.joints, truth.joints, mask),
        depth_order=metrics.depth_order(roots, true_roots, mask),
        seconds=seconds,
        peak_mb=peak_mb,
    )
    details = Details(
        w_mpjpe_mm=alignment.w_mpjpe(people.joints, truth.joints, mask, with_scale=False),
        w_mpjpe_scaled_mm=alignment.w_mpjpe(people.joints, truth.joints, mask, with_scale=True),
        wa_mpjpe_mm=alignment.wa_mpjpe(people.joints, truth.joints, mask, with_scale=False),
        wa_mpjpe_scaled_mm=alignment.wa_mpjpe(people.joints, truth.joints, mask, with_scale=True),
        group_w_scaled_mm=alignment.group_w(people.joints, truth.joints, mask, with_scale=True),
        true_jitter_wham=motion.jitter_wham(truth.joints, mask, rate),
        penetration_share=motion.penetration_share(people.vertices, truth.scenery, mask),
        own_penetration_mm=motion.penetration(people.soles, solution.ground, mask),
    )
    return SceneScores(scene.name, measures, details, _series(metrics.root_errors(roots, true_roots, mask)))


def pose_people(solution: Solution, body: BodyModel) -> PosedPeople:
    """Joints and vertices by forward kinematics: scale * FK(theta, rest joints of betas) + gamma."""
    joints, vertices = [], []
    for theta, gamma, betas, scale in zip(solution.theta, solution.gamma, solution.betas, solution.scales, strict=True):
        rest = body.rest_joints(betas)
        rotations, positions = pose_joints(theta, rest)
        points = skin(body.rest_vertices(betas)[body.proxy], body.weights[body.proxy], rotations, positions, rest)
        joints.append(scale * positions + gamma[:, None])
        vertices.append(scale * points + gamma[:, None])
    proxy = np.stack(vertices)
    heights = np.array([s * body.height(b) for s, b in zip(solution.scales, solution.betas, strict=True)])
    return PosedPeople(np.stack(joints), proxy, proxy[:, :, sole_rows(body)], heights)


def mean_row(preset: str, ablation: str, seeds: Sequence[int], scores: Sequence[SceneScores]) -> Row:
    """Sum scenes up: each counts alike, whatever its length."""

    def mean(name: str) -> float | None:
        return metrics.mean_or_none(
            np.array([v for v in (getattr(score.measures, name) for score in scores) if v is not None])
        )

    return Row(preset, ablation, tuple(seeds), Measures(**{name: mean(name) for name in MEASURES}))


def _frame_rate(times: Array) -> float:
    return float(1 / np.median(np.diff(times))) if len(times) > 1 else 1.0


def _series(errors: Array) -> tuple[tuple[float | None, ...], ...]:
    return tuple(tuple(round(e, 1) if np.isfinite(e) else None for e in person.tolist()) for person in errors)
