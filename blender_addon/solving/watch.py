# SPDX-License-Identifier: GPL-3.0-or-later
"""The solve that goes on beside Blender: looked at by a timer, so that Blender stays the user's all the while.

A timer and no modal operator: Blender saves no automatic backups while one is running, and a solve takes minutes.
"""

from dataclasses import dataclass
from pathlib import Path

import bpy

from core_solver.errors import UserError

from .process import SolverProcess
from .request import SolveRequest

rpt_ = bpy.app.translations.pgettext_rpt

LOG = "Solve Log"
"""Name of the text that shows what the solver says."""

_EVERY_S = 0.2


@dataclass
class Watch:
    """A solve in the window's background.

    Attributes:
        process: at work.
        import_result: whether to bring in the take at the end.
        same_file: whether the file is still open in which it was begun.
    """

    process: SolverProcess
    import_result: bool
    same_file: bool = True


@dataclass(frozen=True)
class Outcome:
    """How the last solve ended.

    Attributes:
        message: for the user.
        good: whether there is a take.
    """

    message: str
    good: bool


# Only one solve at a time: it uses the whole machine.
_watch: Watch | None = None
_outcome: Outcome | None = None


def current() -> Watch | None:
    """The solve that goes on."""
    return _watch


def last_outcome() -> Outcome | None:
    """How the last solve of this session ended; None before, and while one goes on."""
    return _outcome


def begin(python: Path, request: SolveRequest, *, import_result: bool) -> None:
    """Start to solve in the background.

    Raises:
        UserError: one is running already, or it cannot be started.
    """
    global _watch, _outcome
    if _watch is not None:
        raise UserError("a video is being solved already: wait or cancel it")
    _watch, _outcome = Watch(SolverProcess(python, request), import_result), None
    bpy.app.handlers.load_post.append(_another_file)
    bpy.app.timers.register(_look, first_interval=_EVERY_S, persistent=True)


def stop() -> None:
    """Give up the running solve, if any, and wait until it is gone: Blender or the extension is going."""
    if _watch is not None:
        if bpy.app.timers.is_registered(_look):
            bpy.app.timers.unregister(_look)
        _watch.process.cancel()
        _watch.process.wait()
        _forget()


def show_log(lines: list[str]) -> None:
    """Keep the solver's words as a text of the open file."""
    text = bpy.data.texts.get(LOG) or bpy.data.texts.new(LOG)
    text.from_string("\n".join(lines) + "\n")


def import_take(request: SolveRequest) -> None:
    """Bring the finished take into the current scene, with its video.

    Raises:
        RuntimeError: Blender's, with what the import reported.
    """
    bpy.ops.import_scene.scene_aware_mocap("EXEC_DEFAULT", True, filepath=str(request.take), footage=str(request.video))


def _look() -> float | None:
    """Blender's timer: the seconds until it shall look again, None for never."""
    watch = _watch
    if watch is None:
        return None
    known = len(watch.process.lines)
    running = watch.process.poll()
    if len(watch.process.lines) > known:
        show_log(watch.process.lines)
    if not running:
        _forget()
        _finish(watch)
    _redraw()
    return _EVERY_S if running else None


def _finish(watch: Watch) -> None:
    global _outcome  # noqa: PLW0603 - the one solve of this Blender
    window = bpy.context.window_manager.windows[0]
    with bpy.context.temp_override(window=window):
        try:
            watch.process.check()
            take = watch.process.request.take
            message = rpt_("Solved: {}").format(take.name)
            if watch.import_result and watch.same_file:
                import_take(watch.process.request)
            elif watch.import_result:
                message = rpt_("Solved: {}. Another file is open by now: import the take yourself").format(take)
            _outcome = Outcome(message, good=True)
        except (UserError, RuntimeError) as error:
            _outcome = Outcome(str(error).strip(), good=False)
        if not watch.process.cancelled:
            bpy.context.window_manager.popup_menu(
                _draw_outcome, title="Solve Video", icon="INFO" if _outcome.good else "ERROR"
            )


def _draw_outcome(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    if _outcome is not None:
        menu.layout.label(text=_outcome.message, translate=False)


def _forget() -> None:
    global _watch  # noqa: PLW0603 - the one solve of this Blender
    _watch = None
    if _another_file in bpy.app.handlers.load_post:
        bpy.app.handlers.load_post.remove(_another_file)


@bpy.app.handlers.persistent
def _another_file(*_: object) -> None:
    if _watch is not None:
        _watch.same_file = False


def _redraw() -> None:
    """The sidebars and the log; not the views themselves, which may take long to draw."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            shown = {"VIEW_3D": "UI", "TEXT_EDITOR": "WINDOW"}.get(area.type)
            for region in area.regions:
                if region.type == shown:
                    region.tag_redraw()
