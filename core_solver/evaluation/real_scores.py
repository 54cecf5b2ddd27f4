"""A take measured against the truth of a real clip, and sequences summed up in a row."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields

import numpy as np
from numpy.typing import NDArray

from core_solver.evaluation import alignment, metrics, motion
from core_solver.evaluation.metrics import MILLIMETRES, MUPOTS_14, Array, Mask
from core_solver.evaluation.mupots import OfficialScores
from core_solver.evaluation.real_truth import RealTruth
from core_solver.evaluation.scores import Measures
from core_solver.evaluation.take_people import HEAD_TOP, POINT_NAMES, TakePeople
from core_solver.take import JOINT_NAMES

# Names of the joints that 3DPCK counts; a truth may know the top of the head or the head's joint.
PCK_NAMES = frozenset({*(JOINT_NAMES[joint] for joint in MUPOTS_14), HEAD_TOP})
MEAN = "mean"

_KNOWN_SHARE = 0.5  # of the joints must be known, or a frame says too little of the pose
_REACH_SHARE = 0.1  # of the picture's longer side: farther apart on average, two people are not the same


@dataclass(frozen=True)
class RealMeasures(Measures):
    """The measures of synthetic scenes, and those that real truth adds or has in another variant.

    Attributes:
        pair_distance_mm: error of the distances between people.
        pck3d_official_all: 3DPCK of MuPoTS-3D's own program, missed people counted.
        pck3d_official_matched: without them.
        w_mpjpe_mm: 100-frame chunks aligned on two frames, rigidly.
        w_mpjpe_scaled_mm: with scale, as in the usual code.
        wa_mpjpe_mm: chunks aligned as a whole, rigidly.
        wa_mpjpe_scaled_mm: with scale.
        group_w_scaled_mm: all people together, with scale.
        true_jitter_wham: the truth's own.
        found_share: share of the true person-frames that somebody was matched to.
    """

    pair_distance_mm: float | None
    pck3d_official_all: float | None
    pck3d_official_matched: float | None
    w_mpjpe_mm: float | None
    w_mpjpe_scaled_mm: float | None
    wa_mpjpe_mm: float | None
    wa_mpjpe_scaled_mm: float | None
    group_w_scaled_mm: float | None
    true_jitter_wham: float | None
    found_share: float | None


REAL_MEASURES = tuple(field.name for field in fields(RealMeasures))


@dataclass(frozen=True)
class PersonScores:
    """One true person.

    Attributes:
        name: in the truth.
        take_id: of the person of the take who was matched, None for nobody.
        height_m: stature in the take.
        true_height_m: in truth, None where not known.
        mrpe_mm: mean root position error.
        mpjpe_mm: joint error, root-relative.
        jitter_wham: third derivative in 10 m/s^3.
        true_jitter_wham: the truth's own.
    """

    name: str
    take_id: int | None
    height_m: float | None
    true_height_m: float | None
    mrpe_mm: float | None
    mpjpe_mm: float | None
    jitter_wham: float | None
    true_jitter_wham: float | None


@dataclass(frozen=True)
class RealRow:
    """One sequence, or the mean of several.

    Attributes:
        sequence: its name, or `MEAN`.
        preset: how the take was solved.
        measures: numbers.
        people: in the truth's order; of the mean, nobody.
    """

    sequence: str
    preset: str
    measures: RealMeasures
    people: tuple[PersonScores, ...]

    def as_json(self) -> dict[str, object]:
        """The row as programs read it."""
        people = [asdict(person) for person in self.people]
        return {"sequence": self.sequence, "preset": self.preset, **asdict(self.measures), "people": people}


@dataclass(frozen=True)
class Pairing:
    """True people and those of the take who stand for them, in the joints both sides know.

    Attributes:
        matches: (N,) index of the person of the take, -1 for nobody.
        names: (J,) of the joints.
        joints: (N, T, J, 3) of the take; NaN for people who were not found.
        true_joints: (N, T, J, 3).
        roots: (N, T, 3) of the take.
        true_roots: (N, T, 3).
        mask: (N, T) truth is present and the take shows the person.
    """

    matches: NDArray[np.int64]
    names: tuple[str, ...]
    joints: Array
    true_joints: Array
    roots: Array
    true_roots: Array
    mask: Mask

    @property
    def posed(self) -> Mask:
        """(N, T) of the mask, where enough joints are known to speak of a pose."""
        known = np.isfinite(self.true_joints).all(axis=-1).sum(axis=-1)
        return self.mask & (known >= _KNOWN_SHARE * len(self.names))


def pair_up(truth: RealTruth, people: TakePeople, longer_side: int) -> Pairing:
    """Match people by where they are in the image over the whole clip, and put them in the truth's order.

    Args:
        truth: of the take's frames.
        people: of the take.
        longer_side: of the picture, in pixels.
    """
    matches = metrics.match_in_picture(
        people.root_pixels, truth.root_pixels, people.found, truth.present, _REACH_SHARE * longer_side
    )
    names = tuple(name for name in truth.joint_names if name in POINT_NAMES)
    joints = people.points[:, :, [POINT_NAMES.index(name) for name in names]]
    matched = matches >= 0
    return Pairing(
        matches=matches,
        names=names,
        joints=_of_matched(joints, matches),
        true_joints=truth.joints[:, :, [truth.joint_names.index(name) for name in names]],
        roots=_of_matched(people.roots, matches),
        true_roots=truth.roots,
        mask=truth.present & matched[:, None] & (_of_matched(people.found.astype(float), matches) == 1),
    )


def measure(truth: RealTruth, people: TakePeople, pairing: Pairing, official: OfficialScores | None) -> RealMeasures:
    """All measures of one sequence.

    Joint errors are relative to the middle of the hips, which is no joint itself and so not counted.
    """
    joints, true_joints, posed = pairing.joints, pairing.true_joints, pairing.posed
    relative, true_relative = joints - pairing.roots[:, :, None], true_joints - pairing.true_roots[:, :, None]
    counted = [index for index, name in enumerate(pairing.names) if name in PCK_NAMES]
    roots = (pairing.roots, pairing.true_roots, pairing.mask)
    errors = metrics.known_errors(relative, true_relative, posed)
    counted_errors = metrics.known_errors(relative[:, :, counted], true_relative[:, :, counted], posed)
    heights = people.heights[pairing.matches] if len(people.heights) else np.zeros(len(pairing.matches))
    return RealMeasures(
        mrpe_mm=metrics.mrpe(*roots),
        ap25_matched=metrics.ap25_matched(*roots),
        ap25=_average_precision(truth, people, pairing.matches),
        pck3d=metrics.mean_or_none(counted_errors < metrics.PCK_REACH_M),
        mpjpe_mm=metrics.mean_or_none(errors * MILLIMETRES),
        pa_mpjpe_mm=metrics.pa_mpjpe(joints, true_joints, posed),
        jitter_paper_mm=motion.jitter_paper(joints, true_joints, pairing.mask),
        jitter_wham=motion.jitter_wham(joints, pairing.mask, people.frame_rate),
        skate_mm=None,
        penetration_mm=None,
        contact_f1=None,
        height_error=metrics.height_error(np.where(pairing.matches >= 0, heights, np.nan), truth.heights),
        group_w_mm=alignment.group_w(joints, true_joints, posed),
        depth_order=metrics.depth_order(*roots),
        seconds=None,
        peak_mb=None,
        pair_distance_mm=metrics.pair_distance(*roots),
        pck3d_official_all=official and official.all,
        pck3d_official_matched=official and official.matched,
        w_mpjpe_mm=alignment.w_mpjpe(joints, true_joints, posed, with_scale=False),
        w_mpjpe_scaled_mm=alignment.w_mpjpe(joints, true_joints, posed, with_scale=True),
        wa_mpjpe_mm=alignment.wa_mpjpe(joints, true_joints, posed, with_scale=False),
        wa_mpjpe_scaled_mm=alignment.wa_mpjpe(joints, true_joints, posed, with_scale=True),
        group_w_scaled_mm=alignment.group_w(joints, true_joints, posed, with_scale=True),
        true_jitter_wham=motion.jitter_wham(true_joints, pairing.mask, people.frame_rate),
        found_share=metrics.mean_or_none(pairing.mask[truth.present]),
    )


def person_scores(truth: RealTruth, people: TakePeople, pairing: Pairing) -> tuple[PersonScores, ...]:
    """How each true person fared."""
    relative = pairing.joints - pairing.roots[:, :, None]
    true_relative = pairing.true_joints - pairing.true_roots[:, :, None]
    scores = []
    for n, match in enumerate(pairing.matches):
        one = slice(n, n + 1)
        errors = metrics.known_errors(relative[one], true_relative[one], pairing.posed[one])
        scores.append(
            PersonScores(
                name=truth.person_names[n],
                take_id=people.ids[match] if match >= 0 else None,
                height_m=float(people.heights[match]) if match >= 0 else None,
                true_height_m=float(truth.heights[n]) if np.isfinite(truth.heights[n]) else None,
                mrpe_mm=metrics.mrpe(pairing.roots[one], pairing.true_roots[one], pairing.mask[one]),
                mpjpe_mm=metrics.mean_or_none(errors * MILLIMETRES),
                jitter_wham=motion.jitter_wham(pairing.joints[one], pairing.mask[one], people.frame_rate),
                true_jitter_wham=motion.jitter_wham(pairing.true_joints[one], pairing.mask[one], people.frame_rate),
            )
        )
    return tuple(scores)


def mean_of(rows: Sequence[RealRow]) -> RealRow:
    """Each sequence counts alike, whatever its length; a measure's mean runs over the sequences that have it."""

    def mean(name: str) -> float | None:
        return metrics.mean_or_none(
            np.array([v for v in (getattr(row.measures, name) for row in rows) if v is not None])
        )

    presets = sorted({row.preset for row in rows})
    return RealRow(MEAN, ", ".join(presets), RealMeasures(**{name: mean(name) for name in REAL_MEASURES}), ())


def _average_precision(truth: RealTruth, people: TakePeople, matches: NDArray[np.int64]) -> float | None:
    """Of everybody in the take, invented people included.

    Somebody matched is not blamed for frames in which the truth does not know where they are.
    """
    found = people.found.copy()
    for n, match in enumerate(matches):
        if match >= 0:
            found[match] &= truth.present[n]
    return metrics.average_precision(people.roots, people.scores, found, truth.roots, truth.present)


def _of_matched(values: Array, matches: NDArray[np.int64]) -> Array:
    """(N, ...) from (P, ...): the entries of the matched people, NaN for nobody's."""
    chosen = np.full((len(matches), *values.shape[1:]), np.nan)
    chosen[matches >= 0] = values[matches[matches >= 0]]
    return chosen
