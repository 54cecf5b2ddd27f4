"""Files that are not what they should be."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from hypothesis import strategies as st

from core_solver.errors import UserError

T = TypeVar("T")


@st.composite
def damaged(draw: st.DrawFn, whole: bytes) -> bytes:
    """Anything at all, or a whole file cut off, with changed bytes, or with some put in."""
    kind = draw(st.sampled_from(["anything", "cut", "changed", "stuffed"]))
    if kind == "anything":
        return draw(st.binary(max_size=200))
    place = draw(st.integers(0, len(whole)))
    if kind == "cut":
        return whole[:place]
    other = draw(st.binary(min_size=1, max_size=8))
    return whole[:place] + other + whole[place + (len(other) if kind == "changed" else 0) :]


def value_or_user_error(path: Path, content: bytes, read: Callable[[Path], T]) -> T | None:
    """What the reader gives; its only way out is a UserError of one line that names the file."""
    path.write_bytes(content)
    complaint = ""
    try:
        return read(path)
    except UserError as error:
        complaint = str(error)
    assert path.name in complaint
    assert "\n" not in complaint
    return None
