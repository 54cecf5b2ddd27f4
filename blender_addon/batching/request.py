# SPDX-License-Identifier: GPL-3.0-or-later
"""What a command line asks for. Standard library only, but for the presets of bone maps."""

import argparse
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..export.profiles import GENERIC, Profile, load_profile, profile_ids
from ..retarget.presets import built_in_presets

AUTO = "auto"
CLEANING = ("gaps", "smooth", "drift", "ground", "footlock")
"""Steps of cleaning in the order in which they do least harm to each other; users may name them in any."""

_HIGHEST_RATE = 1000
"""Frames per second, as in the sidebar."""

RIG_ENDINGS = (".glb", ".gltf", ".vrm", ".fbx", ".blend")


@dataclass(frozen=True)
class Request:
    """What is to be done with every take.

    Attributes:
        takes: the files.
        out: the one file that all people of the one take go to, with the camera; None for `folder`.
        folder: where the files of all takes go; None for `out`.
        profile: how the files are written.
        people: names or ids; empty for everybody.
        cleaning: of `CLEANING`.
        rig: the character that people move; None to write the people themselves.
        bone_map: `AUTO`, or the title of a preset.
        refine: whether retargeting goes over the whole scene once more.
        report: where the report goes; None for nowhere.
    """

    takes: tuple[Path, ...]
    out: Path | None
    folder: Path | None
    profile: Profile
    people: tuple[str, ...]
    cleaning: tuple[str, ...]
    rig: Path | None
    bone_map: str
    refine: bool
    report: Path | None


def parse(words: Sequence[str], program: str) -> Request:
    """Read a command line.

    Raises:
        SystemExit: with code 2 and one line on stderr where it makes no sense, with 0 after --help.
    """
    parser = _parser(program)
    given = parser.parse_args(words)
    if (given.out is None) == (given.export is None):
        parser.error("give either --out FILE for one take or --export DIR")
    if given.out is not None and len(given.take) > 1:
        parser.error("--out takes one take: give --export DIR for several")
    profile = load_profile(given.engine)
    if given.out is not None:
        profile = replace(profile, format=given.out.suffix.lower().removeprefix("."), one_file_each=False)
    if given.format:
        profile = replace(profile, format=given.format)
    if given.motion_only:
        profile = replace(profile, meshes=False)
    if given.frame_rate:
        profile = replace(profile, frame_rate=given.frame_rate)
    return Request(
        takes=tuple(given.take),
        out=given.out,
        folder=given.export,
        profile=profile,
        people=() if given.person == "all" else tuple(given.person.split(",")),
        cleaning=given.clean,
        rig=given.rig,
        bone_map=given.map,
        refine=not given.no_refine,
        report=given.report,
    )


def _parser(program: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=program,
        description="Bring takes onto a character and write files for a game engine.",
        epilog="Exit codes: 0 all done, 1 some takes failed and the others are done, 2 a bad call.",
    )
    parser.add_argument("--take", type=Path, nargs="+", action="extend", required=True, help="take files (.npz)")
    parser.add_argument("--export", type=Path, metavar="DIR", help="folder for the files; named after the takes")
    parser.add_argument("--out", type=_output, metavar="FILE", help="one .glb or .fbx with all people and the camera")
    parser.add_argument("--engine", choices=profile_ids(), default=GENERIC, help="what the files are for")
    parser.add_argument("--format", choices=("glb", "fbx"), help="another format than the engine's")
    parser.add_argument("--frame-rate", type=_frame_rate, metavar="FPS", help="of the files; the take's when left out")
    parser.add_argument("--motion-only", action="store_true", help="no meshes: armatures and motion alone")
    parser.add_argument("--person", default="all", metavar="all|ID", help="names or ids, with commas between")
    parser.add_argument("--clean", type=_cleaning, default=(), metavar="STEPS", help=f"of {','.join(CLEANING)}")
    parser.add_argument("--rig", type=_rig, help=f"the character: a file that ends in {', '.join(RIG_ENDINGS)}")
    parser.add_argument("--map", type=_bone_map, default=AUTO, metavar="auto|PRESET", help="which bone is which")
    parser.add_argument("--no-refine", action="store_true", help="retarget without going over the whole scene again")
    parser.add_argument("--report", type=Path, metavar="FILE", help="JSON report of what was done")
    return parser


def _output(word: str) -> Path:
    if Path(word).suffix.lower() not in {".glb", ".fbx"}:
        raise argparse.ArgumentTypeError(f"{word!r} must end in .glb or .fbx")
    return Path(word)


def _frame_rate(word: str) -> float:
    try:
        rate = float(word)
    except ValueError:
        rate = math.nan
    if not 0 < rate <= _HIGHEST_RATE:
        raise argparse.ArgumentTypeError(f"{word!r} is no frame rate: give one above 0, {_HIGHEST_RATE} at most")
    return rate


def _rig(word: str) -> Path:
    path = Path(word)
    if path.suffix.lower() not in RIG_ENDINGS:
        raise argparse.ArgumentTypeError(f"{word!r} must end in {', '.join(RIG_ENDINGS)}")
    # Unlike pathlib's, this says no where the system keeps the file from us.
    if not os.path.isfile(path):  # noqa: PTH113
        raise argparse.ArgumentTypeError(f"{word!r} is not there: check the path")
    return path


def _cleaning(word: str) -> tuple[str, ...]:
    steps = {step.strip() for step in word.split(",") if step.strip()}
    unknown = steps.difference(CLEANING)
    if unknown:
        raise argparse.ArgumentTypeError(f"no step {min(unknown)!r}: choose of {', '.join(CLEANING)}")
    return tuple(step for step in CLEANING if step in steps)


def _bone_map(word: str) -> str:
    titles = [preset.title for preset in built_in_presets()]
    chosen = next((title for title in (AUTO, *titles) if title.casefold() == word.casefold()), None)
    if chosen is None:
        raise argparse.ArgumentTypeError(f"no bone map {word!r}: choose {AUTO} or one of {', '.join(titles)}")
    return chosen
