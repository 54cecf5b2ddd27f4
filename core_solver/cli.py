"""`scene-aware-mocap`: thin commands over the pipeline, the preview and the model store.

Exit codes: 0 done; 1 unexpected; 2 something the user can mend; 130 stopped with Ctrl-C.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import os
import shlex
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from core_solver import __version__
from core_solver.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from core_solver.progress import Progress

    # The type of what `add_subparsers` returns has no public name.
    Commands = argparse._SubParsersAction[argparse.ArgumentParser]

DEBUG_VARIABLE = "SCENE_AWARE_MOCAP_DEBUG"

_PROGRAM = "scene-aware-mocap"
_PRESETS = {
    "fast": "the default",
    "exact": "every pixel counts from the beginning, and more iterations: slower",
    "paper": "the method as it was published, for comparison",
}
_UNEXPECTED, _USER_ERROR, _INTERRUPTED = 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return the process's exit code."""
    debug = bool(os.environ.get(DEBUG_VARIABLE))
    stopped = "stopped: nothing was begun"
    try:
        options = _parser().parse_args(arguments)
        debug = debug or options.debug
        stopped = options.stopped
        _start_logging(verbose=options.verbose, debug=debug)
        code: int = options.run(options)
        sys.stdout.flush()
    except UserError as error:
        return _fail(f"error: {_one_line(error)}", _USER_ERROR, debug=debug)
    except KeyboardInterrupt:
        return _fail(stopped, _INTERRUPTED, debug=debug)
    except BrokenPipeError:
        # The reader (`| head`) has gone; without this, Python would complain when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _UNEXPECTED
    except Exception as error:  # noqa: BLE001 - the last resort: the user sees a line instead of a traceback
        kind = type(error).__name__
        message = f"error: unexpected {kind}: {_one_line(error)} (run with --debug for the whole story)"
        return _fail(message, _UNEXPECTED, debug=debug)
    return code


def solve(options: argparse.Namespace) -> int:
    """Video in, take out, and a summary."""
    _check_solve(options)
    from core_solver.console import BarProgress, JsonProgress  # noqa: PLC0415 - keeps --help and bad input fast
    from core_solver.inspection import describe, take_facts  # noqa: PLC0415
    from core_solver.pipeline import SolveOptions, solve_video  # noqa: PLC0415

    progress = JsonProgress() if options.progress == "json" else BarProgress()
    wanted = {name: getattr(options, name) for name in SolveOptions.__dataclass_fields__ if hasattr(options, name)}
    take = solve_video(SolveOptions(**wanted), progress)
    for line in describe(take_facts(take, options.output)):
        print(line)
    print("time per stage")
    print(progress.summary())
    video, output = shlex.quote(str(options.video)), shlex.quote(str(options.output))
    preview_directory = shlex.quote(str(options.output.with_suffix("")) + "_preview")
    print(f"take: {options.output}")
    print(f"look at it: {_PROGRAM} preview {output} {video} -o {preview_directory}")
    print("use it: File > Import > Import Scene-Aware Mocap (.npz) in Blender")
    return 0


def preview(options: argparse.Namespace) -> int:
    """Overlay video and overview picture of a take."""
    from core_solver.console import BarProgress  # noqa: PLC0415
    from core_solver.preview import write_preview  # noqa: PLC0415
    from core_solver.take import read_take  # noqa: PLC0415

    _require_file(options.video, "video")
    for path in write_preview(read_take(options.take), options.video, options.output, BarProgress()):
        print(path)
    return 0


def report(options: argparse.Namespace) -> int:
    """A take as one self-contained web page."""
    from core_solver.console import BarProgress  # noqa: PLC0415
    from core_solver.report import write_report  # noqa: PLC0415

    if options.video is not None:
        _require_file(options.video, "video")
    write_report(options.take, options.video, options.output, BarProgress())
    print(f"{options.output}  ({options.output.stat().st_size / 1e6:.1f} MB, open it in a browser)")
    return 0


def inspect(options: argparse.Namespace) -> int:
    """What is in a take."""
    from core_solver.inspection import describe, take_facts  # noqa: PLC0415
    from core_solver.take import read_take  # noqa: PLC0415

    facts = take_facts(read_take(options.take), options.take)
    print(json.dumps(facts.as_json(), indent=2) if options.json else "\n".join(describe(facts)))
    return 0


def _progress_bars() -> Progress:
    from core_solver.console import BarProgress  # noqa: PLC0415 - keeps --help and bad input fast

    return BarProgress()


class _Parser(argparse.ArgumentParser):
    """Complains like the rest of the program: one line, exit code 2."""

    def error(self, message: str) -> NoReturn:
        raise UserError(f"{message} (see {self.prog} --help)")


def _parser() -> argparse.ArgumentParser:
    from core_solver.evaluation import cli as evaluation_cli  # noqa: PLC0415
    from core_solver.perception import models_cli  # noqa: PLC0415

    parser = _program_parser()
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for add in (_add_solve, _add_preview, _add_report, _add_inspect):
        _add_common(add(commands), default=argparse.SUPPRESS)
    models_cli.add_parser(commands)
    for kind in evaluation_cli.add_parser(commands, _progress_bars):
        _add_common(kind, default=argparse.SUPPRESS)
    return parser


def _program_parser() -> argparse.ArgumentParser:
    parser = _Parser(prog=_PROGRAM, description="Several people from one video of one static camera, in metres.")
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    _add_common(parser, default=False)
    parser.set_defaults(stopped="stopped: older files are untouched; give the same command to begin again")
    return parser


def _add_common(parser: argparse.ArgumentParser, default: object) -> None:
    """-v and --debug work before and after the command; SUPPRESS keeps the later parser from undoing the earlier."""
    parser.add_argument("-v", "--verbose", action="store_true", default=default, help="say more while working")
    parser.add_argument("--debug", action="store_true", default=default, help="show tracebacks and all messages")


def _add_solve(commands: Commands) -> argparse.ArgumentParser:
    parser = commands.add_parser(
        "solve",
        help="solve a video: people, scene and camera into one take",
        epilog="\n".join(["presets:", *(f"  {name:<6} {meaning}" for name, meaning in _PRESETS.items())]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("video", type=Path, metavar="VIDEO")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="TAKE.npz", help="where the take goes")
    lens = parser.add_mutually_exclusive_group()
    lens.add_argument(
        "--camera", metavar="FILE[:NAME]", help="camera file: our JSON, 3x3 text, OpenCV YAML, QTM .qca.txt"
    )
    lens.add_argument(
        "--fov",
        dest="fov_degrees",
        type=_number(5, 150),
        metavar="DEGREES",
        help="field of view along the longer side of the picture, 5 to 150",
    )
    parser.add_argument(
        "--rotate",
        type=int,
        choices=(90, 180, 270),
        default=0,
        help="turn the picture clockwise: a wrong rotation flag",
    )
    parser.add_argument("--start", dest="start_s", type=_number(0), metavar="S", help="first second to solve")
    parser.add_argument("--end", dest="end_s", type=_number(0), metavar="S", help="second to stop at")
    parser.add_argument("--every", type=_count, default=1, metavar="N", help="use every Nth frame")
    parser.add_argument("--people", type=_count, metavar="N", help="keep the N people seen best")
    parser.add_argument(
        "--identities", type=Path, metavar="FILE", help="who is who: TAKE.work/identities.json with your edits"
    )
    parser.add_argument(
        "--depth", type=Path, metavar="MODEL", help="disparity network (.onnx), or a directory of sizes"
    )
    parser.add_argument(
        "--network",
        dest="networks",
        action="append",
        default=[],
        metavar="FILE.toml",
        help="a network of your own, or a name that 'models list' shows; may be given several times",
    )
    parser.add_argument(
        "--modalities", type=Path, metavar="DIR", help="joints, SMPL poses, depth and masks that you have already"
    )
    parser.add_argument(
        "--points", type=_count, default=argparse.SUPPRESS, metavar="N", help="most points in the cloud (200000)"
    )
    parser.add_argument("--models-dir", type=Path, metavar="DIR", help="where models are kept")
    parser.add_argument("--offline", action="store_true", help="fetch no models: those that are missing are an error")
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    parser.add_argument("--resume", action="store_true", help="go on from what an earlier run has kept in TAKE.work")
    parser.add_argument("--body", type=Path, metavar="FILE", help="your own SMPL file (.npz or .pkl)")
    parser.add_argument("--preset", choices=tuple(_PRESETS), default="fast", help="how to solve; see below")
    parser.add_argument(
        "--progress", choices=("bars", "json"), default="bars", help="bars for people, or one JSON object a line"
    )
    parser.set_defaults(
        run=solve, stopped="stopped: an older take is untouched; give the same command with --resume to go on"
    )
    return parser


def _add_preview(commands: Commands) -> argparse.ArgumentParser:
    parser = commands.add_parser("preview", help="draw a take over its video, and the scene from above")
    parser.add_argument("take", type=Path, metavar="TAKE")
    parser.add_argument("video", type=Path, metavar="VIDEO")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.set_defaults(run=preview)
    return parser


def _add_report(commands: Commands) -> argparse.ArgumentParser:
    parser = commands.add_parser("report", help="a take as one web page: footage, 3D view, measures, warnings")
    parser.add_argument("take", type=Path, metavar="TAKE")
    parser.add_argument("--video", type=Path, metavar="V", help="the take's video, shown small with bodies over it")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="REPORT.html")
    parser.set_defaults(run=report)
    return parser


def _add_inspect(commands: Commands) -> argparse.ArgumentParser:
    parser = commands.add_parser("inspect", help="say what is in a take")
    parser.add_argument("take", type=Path, metavar="TAKE")
    parser.add_argument("--json", action="store_true", help="for programs: keys stay the same")
    parser.set_defaults(run=inspect)
    return parser


def _check_solve(options: argparse.Namespace) -> None:
    """Refuse at once what would otherwise fail after minutes of work."""
    _require_file(options.video, "video")
    output: Path = options.output
    if output.suffix != ".npz" or output.is_dir():
        raise UserError(f"{output} is no name for a take: give a file that ends in .npz with -o")
    blocked = next((p for p in output.parents if p.exists()), None)
    if blocked is not None and not (blocked.is_dir() and os.access(blocked, os.W_OK)):
        raise UserError(f"nothing can be written in {output.parent}: choose another place with -o")
    if options.start_s is not None and options.end_s is not None and options.end_s <= options.start_s:
        raise UserError(f"--end {options.end_s:g} is not after --start {options.start_s:g}")
    files = ("depth", "body", "identities", "modalities")
    for path, flag in ((getattr(options, name), f"--{name}") for name in files):
        if path is not None and not path.exists():
            raise UserError(f"there is no file {path}: check {flag}")


def _require_file(path: Path, what: str) -> None:
    if path.is_dir():
        raise UserError(f"{path} is a directory: give the {what} itself")
    if not path.is_file():
        raise UserError(f"there is no {what} at {path}: check the path")


def _number(low: float, high: float = math.inf) -> Callable[[str], float]:
    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (low <= value <= high and math.isfinite(value)):
            wanted = f"a number from {low:g} to {high:g}" if math.isfinite(high) else f"a number of at least {low:g}"
            raise argparse.ArgumentTypeError(f"{text!r} is not {wanted}")
        return value

    return parse


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 1")
    return int(text)


def _start_logging(*, verbose: bool, debug: bool) -> None:
    """Warnings read like our other lines; whoever asks for more also learns which part of the program speaks."""
    level = logging.DEBUG if debug else logging.INFO if verbose else logging.WARNING
    logging.addLevelName(logging.WARNING, "warning")
    logging.basicConfig(
        level=level, format="%(levelname)s %(name)s: %(message)s" if verbose or debug else "%(levelname)s: %(message)s"
    )


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


def _fail(message: str, code: int, *, debug: bool) -> int:
    if debug:
        traceback.print_exc()
    print(message, file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
