# SPDX-License-Identifier: GPL-3.0-or-later
"""What the solver is asked to do, and the words that tell it so. No Blender in here."""

import os
from dataclasses import dataclass
from pathlib import Path

from core_solver.errors import UserError


@dataclass(frozen=True)
class SolveRequest:
    """One video to solve; zeros and empty strings leave a choice to the solver.

    Attributes:
        video: the footage.
        output: the take to write, or None for the video's name beside it.
        preset: how to solve: "fast", "exact" or "paper".
        camera: calibration file.
        camera_name: which camera of a file that holds several.
        fov_degrees: field of view along the picture's longer side.
        people: keep so many, those seen best.
        start_s: first second to solve.
        end_s: second to stop at.
        every: use every Nth frame.
        depth: disparity network, or a folder with one in several sizes.
        rotate: degrees by which the picture is turned clockwise.
        device: what computes: "auto", "cpu" or "cuda".
        resume: go on from what an earlier run has kept.
        offline: let the solver fetch nothing, not even its networks the first time.
    """

    video: Path
    output: Path | None = None
    preset: str = "fast"
    camera: str = ""
    camera_name: str = ""
    fov_degrees: float = 0.0
    people: int = 0
    start_s: float = 0.0
    end_s: float = 0.0
    every: int = 1
    depth: str = ""
    rotate: int = 0
    device: str = "auto"
    resume: bool = False
    offline: bool = False

    @property
    def take(self) -> Path:
        """Where the take goes."""
        return self.output or self.video.with_suffix(".npz")

    @property
    def log(self) -> Path:
        """Where the solver's words are kept."""
        return self.take.with_suffix(".solve.log")

    def check(self) -> None:
        """Refuse what the solver would refuse.

        Raises:
            UserError: what is wrong and what to do.
        """
        if not self.video.is_file():
            raise UserError(f"there is no video at {self.video}: choose the file")
        if self.take.suffix != ".npz":
            raise UserError(f"{self.take.name} is no name for a take: it must end in .npz")
        folder = next((place for place in self.take.parents if place.exists()), None)
        if folder is None or not folder.is_dir() or not os.access(folder, os.W_OK):
            raise UserError(f"nothing can be written in {self.take.parent}: choose another place for the take")
        if self.camera and self.fov_degrees:
            raise UserError("a camera file and a field of view contradict each other: give one of them")
        if self.end_s and self.end_s <= self.start_s:
            raise UserError(f"the end at {self.end_s:g} s is not after the start at {self.start_s:g} s")

    def words(self) -> list[str]:
        """What follows the program's name on a command line."""
        camera = f"{self.camera}:{self.camera_name}" if self.camera_name else self.camera
        choices = {
            "--camera": camera,
            "--fov": f"{self.fov_degrees:g}" if self.fov_degrees else "",
            "--people": str(self.people) if self.people else "",
            "--start": f"{self.start_s:g}" if self.start_s else "",
            "--end": f"{self.end_s:g}" if self.end_s else "",
            "--depth": self.depth,
            "--rotate": str(self.rotate) if self.rotate else "",
        }
        return [
            *("solve", str(self.video), "--output", str(self.take), "--progress", "json"),
            *("--preset", self.preset, "--every", str(self.every), "--device", self.device),
            *(word for option, value in choices.items() if value for word in (option, value)),
            *(["--resume"] if self.resume else []),
            *(["--offline"] if self.offline else []),
        ]
