"""Pictures of a take for people to judge: bodies over the footage, and the scene from above."""

from pathlib import Path

from core_solver.errors import UserError
from core_solver.preview.overlay import TakeOverFootage, write_overlay
from core_solver.preview.overview import write_overview
from core_solver.progress import Progress
from core_solver.take import Take

__all__ = ["write_preview"]


def write_preview(take: Take, video: Path, out: Path, progress: Progress) -> tuple[Path, Path]:
    """Write `overlay.mp4` and `overview.png` into a directory.

    Args:
        take: the take.
        video: the video it was solved from.
        out: directory, made if missing.
        progress: told frame by frame.

    Returns:
        The paths of the overlay and the overview.

    Raises:
        UserError: the video is another one or unreadable, or the files cannot be written; older ones then stay.
    """
    footage = TakeOverFootage(take, video)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"cannot make the directory {out}: {error.strerror}; choose another place with -o") from error
    overlay, overview = out / "overlay.mp4", out / "overview.png"
    with progress.stage("overview", min(4, take.frame_count)) as advance:
        write_overview(footage, overview, advance)
    with progress.stage("overlay", take.frame_count) as advance:
        write_overlay(footage, overlay, advance)
    return overlay, overview
