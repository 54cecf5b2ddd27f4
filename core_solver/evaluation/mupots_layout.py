"""Sequences in the layout of MuPoTS-3D: TSn with img_%06d.jpg counted from 0, annot.mat and occlusion.mat.

`annotations` is a cell array (frames, people) of structs: `annot2` (2, 17) pixels, `annot3` and `univ_annot3` (3, 17)
millimetres in the camera's frame, the latter a skeleton of standard size, and `isValidFrame`. occlusion.mat says which
joints are hidden, which no measure here asks.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from core_solver.evaluation.matlab import MatlabError, NewerMatlabError, read_variable
from core_solver.evaluation.metrics import Array
from core_solver.evaluation.mupots import PELVIS, OfficialScores, official_scores
from core_solver.evaluation.real_truth import RealTruth, TruthError, middle_of_hips
from core_solver.evaluation.take_people import HEAD_TOP, POINT_NAMES, TakePeople

ANNOTATIONS = "annot.mat"
JOINT_NAMES = (
    HEAD_TOP, "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist",
    "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", "pelvis", "spine2", "head",
)  # fmt: skip
"""The dataset's 17 joints in the take's names; its spine, halfway from pelvis to neck, is nearest to spine2."""

_COMPARED = 14
_METRES = 0.001


@dataclass(frozen=True)
class MupotsSequence:
    """One sequence, camera frame, metres.

    Attributes:
        truth: the first fourteen joints, in true size.
        standard: (N, T, 17, 3) skeletons of standard size.
        pixels: (N, T, 17, 2).
        annotated: (N, T).
    """

    truth: RealTruth
    standard: Array
    pixels: Array
    annotated: np.ndarray

    def official(self, people: TakePeople) -> OfficialScores:
        """3DPCK of the dataset's own program for the take's frames, which the truth must have."""
        rows = np.searchsorted(self.truth.frames, people.frames)
        points = [POINT_NAMES.index(name) for name in JOINT_NAMES]
        predicted, pixels = people.points[:, :, points], people.pixels[:, :, points]
        # The program wants a pelvis between the hips where a skeleton has its own elsewhere.
        predicted[:, :, PELVIS], pixels[:, :, PELVIS] = people.roots, people.root_pixels
        return official_scores(
            self.standard[:, rows], self.pixels[:, rows], self.annotated[:, rows], predicted, pixels, people.found
        )


def find_sequences(directory: Path) -> list[Path]:
    """The directories TS1, TS2, ... in a directory, by number.

    Raises:
        TruthError: there is none with annotations.
    """
    numbered = [
        (int(match[1]), path)
        for path in directory.glob("TS*")
        if (match := re.fullmatch(r"TS(\d+)", path.name)) and (path / ANNOTATIONS).is_file()
    ]
    if not numbered:
        raise TruthError(f"no sequence of MuPoTS-3D in {directory}: there must be TS1/{ANNOTATIONS} and so on")
    return [path for _, path in sorted(numbered)]


def read_mupots(directory: Path) -> MupotsSequence:
    """Read one sequence.

    Raises:
        TruthError: the annotations are missing or damaged.
    """
    where = f"{directory.name}/{ANNOTATIONS}"
    cells = _read_cells(directory / ANNOTATIONS, where)
    try:
        return _assemble(directory.name, cells)
    except (KeyError, TypeError, ValueError) as error:
        raise TruthError(f"{where}: not as MuPoTS-3D has it ({error}): get the file again") from error


def _read_cells(path: Path, where: str) -> np.ndarray:
    try:
        cells = read_variable(path.read_bytes(), "annotations")
    except NewerMatlabError as error:
        raise TruthError(f"{where}: saved as MATLAB 7.3: save it again in MATLAB with the option -v7") from error
    except (OSError, MatlabError) as error:
        raise TruthError(f"{where}: not a readable MATLAB file ({error}): get it again") from error
    if cells.dtype != object or cells.ndim != 2 or cells.size == 0:
        raise TruthError(f"{where}: `annotations` is no cell array of frames and people: get the file again")
    return cells


def _assemble(name: str, cells: np.ndarray) -> MupotsSequence:
    frames, people = cells.shape
    pixels = np.full((people, frames, 17, 2), np.nan)
    true, standard = np.full((2, people, frames, 17, 3), np.nan)
    annotated = np.zeros((people, frames), bool)
    for frame, person in np.ndindex(frames, people):
        cell = _struct(cells[frame, person])
        if cell is None or not np.any(cell["isValidFrame"]):
            continue
        annotated[person, frame] = True
        pixels[person, frame] = _joints(cell, "annot2", 2)
        true[person, frame] = _joints(cell, "annot3", 3) * _METRES
        standard[person, frame] = _joints(cell, "univ_annot3", 3) * _METRES
    names = JOINT_NAMES[:_COMPARED]
    truth = RealTruth(
        name=name,
        joint_names=names,
        joints=true[:, :, :_COMPARED],
        present=annotated,
        root_pixels=middle_of_hips(pixels[:, :, :_COMPARED], names),
        frames=np.arange(frames),
        person_names=tuple(f"person {person + 1}" for person in range(people)),
        heights=np.full(people, np.nan),
    )
    return MupotsSequence(truth, standard, pixels, annotated)


def _struct(cell: Any) -> dict[str, np.ndarray] | None:
    """The fields of a cell that holds a 1x1 struct, None of an empty cell."""
    if cell.size == 0:
        return None
    if cell.shape != (1, 1) or not isinstance(cell[0, 0], dict):
        raise TypeError("a cell holds no struct")
    return cell[0, 0]


def _joints(cell: dict[str, np.ndarray], name: str, axes: int) -> Array:
    """(17, axes)."""
    values = cell[name].astype(float)
    if values.shape != (axes, 17):
        raise ValueError(f"{name} has the shape {values.shape} instead of {(axes, 17)}")
    return values.T
