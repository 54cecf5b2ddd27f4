"""Which frame a file speaks of: always by the number in its name, never by its place in a list."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from core_solver.errors import UserError

_MOST_BEYOND = 0.05  # of the video's frames: programs disagree by a frame or two about where a video ends


@dataclass(frozen=True)
class Counting:
    """How a set of files counts the video's frames.

    Attributes:
        first: the number of the video's first frame.
        certain: whether the numbers leave no doubt.
    """

    first: int
    certain: bool


def frame_numbers(names: Sequence[str]) -> list[int]:
    """The number of the frame in each name: the last one that differs from name to name.

    `img_000012.jpg` is 12, and so is `cam1_000012-dpt_large_384.png` among others of its kind.

    Raises:
        UserError: a name without a number, or two names with the same one.
    """
    found = [re.findall(r"\d+", _stem(name)) for name in names]
    for name, digits in zip(names, found, strict=True):
        if not digits:
            raise UserError(f"{name} does not say which frame it is: put the frame's number into its name")
    alike = len({re.sub(r"\d+", "#", _stem(name)) for name in names}) == 1
    places = range(-1, -len(found[0]) - 1, -1) if found and alike else [-1]
    for place in places:
        numbers = [int(digits[place]) for digits in found]
        if len(set(numbers)) == len(numbers):
            return numbers
    last = [int(digits[-1]) for digits in found]
    twice = next(i for i, number in enumerate(last) if number in last[:i])
    raise UserError(f"{names[last.index(last[twice])]} and {names[twice]} have the same number: keep one of them")


def count_from(numbers: Collection[int], frame_count: int) -> Counting:
    """Guess which number the video's first frame has.

    Args:
        numbers: of the frames that a set of files speaks of.
        frame_count: of the whole video.
    """
    if not numbers:
        return Counting(0, certain=False)
    lowest, highest = min(numbers), max(numbers)
    if lowest == 0:
        return Counting(0, certain=True)
    if highest - lowest + 1 == frame_count == len(set(numbers)):
        return Counting(lowest, certain=True)
    if highest == frame_count or (lowest == 1 and len(set(numbers)) == highest):
        return Counting(1, certain=True)
    return Counting(1 if lowest == 1 else 0, certain=False)


def agreed_first(countings: Sequence[Counting]) -> list[int]:
    """The first numbers of several sets of files: whoever is in doubt follows those that are not, if they agree."""
    certain = {c.first for c in countings if c.certain}
    common = certain.pop() if len(certain) == 1 else None
    return [c.first if c.certain or common is None else common for c in countings]


def check_range(numbers: Collection[int], first: int, frame_count: int, where: str) -> int:
    """How many numbers lie beyond the video's end; a few do not matter.

    Raises:
        UserError: numbers before the first frame, or many beyond the last.
    """
    indices = np.array(sorted(numbers), dtype=float) - first
    beyond = int(np.count_nonzero(indices >= frame_count))
    if (indices < 0).any() or beyond > max(_MOST_BEYOND * frame_count, 1):
        raise UserError(
            f"{where} speaks of frames {min(numbers)} to {max(numbers)}, but the video has {frame_count} counted from "
            f"{first}: say which number its first frame has with `first` in modalities.toml"
        )
    return beyond


def _stem(name: str) -> str:
    stem = name.replace("\\", "/").rsplit("/", 1)[-1]
    stem = re.sub(r"\.[A-Za-z][A-Za-z0-9]*$", "", stem)
    return re.sub(r"_keypoints$", "", stem)
