# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line, whoever runs it: `batch.py`, `blender -c scene_aware_mocap`, or plain Python with bpy."""

import sys
import traceback
from collections.abc import Sequence

from core_solver.errors import UserError

from .report import TakeReport, write_report
from .request import Request, parse
from .running import clash, run, unreadable

DONE, SOME_FAILED, BAD_CALL = 0, 1, 2


def main(words: Sequence[str], program: str = "batch.py") -> int:
    """Run with the words of a command line and give the exit code; the scene that is open in Blender is closed.

    Args:
        words: without the program.
        program: its name, for messages.
    """
    try:
        request = parse(words, program)
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else BAD_CALL
    except UserError as error:
        return _say(program, str(error), BAD_CALL)
    reason = clash(request) if request.out is None else unreadable(request)
    if reason:
        return _say(program, reason, BAD_CALL)
    reports = [_attempt(request, number, program) for number in range(len(request.takes))]
    if request.report is not None:
        try:
            write_report(request.report, reports)
        except OSError as error:
            return _say(program, f"cannot write the report {request.report}: {error.strerror}", SOME_FAILED)
    return DONE if all(report.passed for report in reports) else SOME_FAILED


def _attempt(request: Request, number: int, program: str) -> TakeReport:
    """One take; whatever happens to it, the others follow."""
    path = request.takes[number]
    try:
        report = run(request, path)
    except Exception as error:  # noqa: BLE001 - a fault of ours in one take must not cost the others
        traceback.print_exc()
        report = TakeReport(path, error=f"unexpected {type(error).__name__}: {error}")
    if report.error:
        _say(program, f"{report.error}", SOME_FAILED)
    for check in report.verification:
        if not check.passed:
            _say(program, f"{check.character} in {check.file} {'; '.join(check.problems)}", SOME_FAILED)
    for file in report.files:
        people = sum(check.file == file.name for check in report.verification)
        sys.stdout.write(f"wrote {file}: {people} people, {report.frames} frames\n")
    return report


def _say(program: str, message: str, code: int) -> int:
    sys.stderr.write(f"{program}: {message}\n")
    return code
