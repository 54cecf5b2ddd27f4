"""`python -m core_solver.evaluation.perception_speed VIDEO`: milliseconds a frame of every network, and memory.

Nothing is solved. The networks look at the clip's beginning and at four times as much of it, each in a process of its
own, so that it can be seen whether memory grows with length.
"""

import argparse
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, cast

from core_solver.errors import UserError
from core_solver.evaluation.memory import peak_mb
from core_solver.perception.perceive import Networks, load_networks, perceive, with_declared
from core_solver.perception.store import ModelStore
from core_solver.progress import SilentProgress
from core_solver.video import VideoClip, open_video

_FRAMES = 100
_SHARE = 4  # the long clip is so many times as long as the short one
_WARM_UP = 2  # frames: networks are slow at first
_PEOPLE, _DEPTH, _BODY = "people", "depth", "each person's body"
_DECLARED = {"finder": _PEOPLE, "poses": "keypoints", "masks": "masks", "bodies": "SMPL bodies", "depth": _DEPTH}
_NAME_WIDTH, _WIDTH = 34, 14


@dataclass(frozen=True)
class Look:
    """What looking at a clip has cost.

    Attributes:
        frames: how many.
        people: detections a frame, mean.
        stages: {name: milliseconds a frame}; decoding alone, then each network while the others run beside it.
        total_ms: a frame, by the clock, with everything that is no network.
        peak_mb: of the process.
    """

    frames: int
    people: float
    stages: Mapping[str, float]
    total_ms: float
    peak_mb: float


@dataclass(frozen=True)
class Order:
    """What to look at and with what, as `scene-aware-mocap solve` takes it."""

    video: Path
    depth: Path | None
    networks: tuple[str, ...]
    models_dir: Path | None

    def carry_out(self, frames: int) -> Look:
        """Look at the clip's first frames.

        Raises:
            UserError: the video or a network is not to be had.
        """
        store = ModelStore(self.models_dir)
        networks = with_declared(load_networks(store, self.depth), self.networks, store, "auto")
        return look_at_clip(open_video(self.video), networks, frames)


class _Timed:
    """A network whose calls are timed."""

    def __init__(self, network: Callable[..., Any]) -> None:
        self._network = network
        self.seconds = 0.0

    def __call__(self, *arguments: object) -> Any:
        started = time.perf_counter()
        try:
            return self._network(*arguments)
        finally:
            self.seconds += time.perf_counter() - started


def look_at_clip(clip: VideoClip, networks: Networks, frames: int) -> Look:
    """Look at a clip's first frames as a solve does, and keep nothing."""
    positions = range(min(frames, len(clip.frame_list)))
    for _ in perceive(clip, networks, SilentProgress(), positions[:_WARM_UP]):
        pass
    watched, stages = _watched(networks, clip)
    started = time.perf_counter()
    people = sum(len(seen.detections) for seen in perceive(clip, watched, SilentProgress(), positions))
    seconds = time.perf_counter() - started
    costs = {"decoding": _decode(clip, positions), **{name: stage.seconds for name, stage in stages.items()}}
    count = len(positions)
    return Look(
        frames=count,
        people=people / count,
        stages={name: 1000 * cost / count for name, cost in costs.items()},
        total_ms=1000 * seconds / count,
        peak_mb=peak_mb(),
    )


def _watched(networks: Networks, clip: VideoClip) -> tuple[Networks, dict[str, _Timed]]:
    """The same networks and their stopwatches, in the order in which they look."""
    declared = {part: getattr(networks.declared, part) for part in _DECLARED}
    # The default depth network is put in the place of a declared one, or it would be opened again.
    declared["depth"] = networks.open_disparity(clip.width, clip.height)
    own: dict[str, Any] = {part: _Timed(network) if network else None for part, network in declared.items()}
    people, body = _Timed(networks.people), _Timed(networks.body)
    found = {_DECLARED[part]: network for part, network in own.items() if network is not None}
    watched = Networks(cast("Any", people), cast("Any", body), (), replace(networks.declared, **own))
    return watched, {_PEOPLE: people, **found, _BODY: body}


def _decode(clip: VideoClip, positions: Sequence[int]) -> float:
    """Seconds."""
    started = time.perf_counter()
    for _ in clip.frames_at(positions):
        pass
    return time.perf_counter() - started


def table(looks: Sequence[Look]) -> str:
    """Stages as rows, clips as columns."""
    rows = [("frames", [f"{look.frames}" for look in looks])]
    rows += [(f"{name}, ms a frame", [f"{look.stages[name]:.1f}" for look in looks]) for name in looks[0].stages]
    rows += [
        ("all by the clock, ms a frame", [f"{look.total_ms:.1f}" for look in looks]),
        ("people a frame", [f"{look.people:.1f}" for look in looks]),
        ("peak memory, MB", [f"{look.peak_mb:.0f}" for look in looks]),
    ]
    return "\n".join(name.ljust(_NAME_WIDTH) + "".join(cell.rjust(_WIDTH) for cell in cells) for name, cells in rows)


def main(arguments: Sequence[str] | None = None) -> int:
    """Look twice and print."""
    parser = argparse.ArgumentParser(prog="python -m core_solver.evaluation.perception_speed", description=__doc__)
    parser.add_argument("video", type=Path, metavar="VIDEO")
    parser.add_argument("--frames", type=int, default=_FRAMES, metavar="N", help=f"of the long clip ({_FRAMES})")
    parser.add_argument("--depth", type=Path, metavar="MODEL", help="as for solve")
    parser.add_argument("--network", dest="networks", action="append", default=[], metavar="NETWORK", help="likewise")
    parser.add_argument("--models-dir", type=Path, metavar="DIR", help="where models are kept")
    options = parser.parse_args(arguments)
    order = Order(options.video, options.depth, tuple(options.networks), options.models_dir)
    try:
        looks = [_in_a_process(order, frames) for frames in _lengths(order.video, options.frames)]
    except UserError as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    sys.stdout.write(table(looks) + "\n")
    return 0


def _lengths(video: Path, frames: int) -> tuple[int, int]:
    """Frames of the short and of the long clip."""
    if frames < _SHARE:
        raise UserError(f"--frames {frames} are too few: give {_SHARE} or more")
    long = min(frames, len(open_video(video).frame_list))
    return max(long // _SHARE, 1), long


def _in_a_process(order: Order, frames: int) -> Look:
    """One that begins anew: memory once taken would count for the next clip, too."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        return process.submit(order.carry_out, frames).result()


if __name__ == "__main__":
    sys.exit(main())
