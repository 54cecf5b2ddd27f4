"""A take as one self-contained web page, for people to judge it by."""

from pathlib import Path

from core_solver.errors import UserError
from core_solver.progress import Progress
from core_solver.report.document import build_document
from core_solver.report.evidence import read_reprojection
from core_solver.report.footage import read_footage
from core_solver.report.packing import Packer
from core_solver.report.page import render_page
from core_solver.take import read_take
from core_solver.text_files import write_text_whole

__all__ = ["write_report"]

_NO_VIDEO = "No footage: the report was made without --video."


def write_report(take_path: Path, video: Path | None, output: Path, progress: Progress) -> None:
    """Write the report page of a take.

    Args:
        take_path: the take; observations in the work directory beside it are used where they are.
        video: its footage, or None.
        output: the page, a name that ends in .html; the same input gives the same bytes.
        progress: told picture by picture.

    Raises:
        UserError: the take or the video cannot be used, or the page cannot be written; an older page then stays.
    """
    if output.suffix.lower() not in {".html", ".htm"} or output.is_dir():
        raise UserError(f"{output} is no name for a page: give a file that ends in .html with -o")
    take = read_take(take_path)
    footage = read_footage(take, video, progress) if video is not None else _NO_VIDEO
    with progress.stage("report", 2) as advance:
        reprojection = read_reprojection(take, take_path.with_suffix(".work"))
        advance(1)
        packer = Packer()
        document = build_document(take, footage, reprojection, packer)
        write_text_whole(output, render_page(document, packer.text()))
        advance(1)
