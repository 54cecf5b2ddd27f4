"""Hands and eyes inside a Blender window: run steps one after the other, click, scroll, take pictures.

Runs in Blender's own Python.
"""

import os
import struct
import sys
import traceback
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np

TAB = "Mocap"
SECTIONS = ("solve", "import", "clean", "retarget", "export")
_SECTION = "VIEW3D_PT_scene_aware_mocap_"
_HEADER = 28  # pixels from one folded section's header to the next


def run(steps: Callable[[], Iterator[float]]) -> None:
    """Go through a generator that yields the seconds to wait; quits Blender at its end, with 1 when it fails."""
    going = steps()

    def go_on() -> float | None:
        try:
            return next(going)
        except StopIteration:
            sys.stdout.write("STEPS DONE\n")
            _quit(0)
        except BaseException:  # noqa: BLE001 - whatever happened, Blender must not stay open
            traceback.print_exc()
            _quit(1)
        return None

    bpy.app.timers.register(go_on, first_interval=1.5, persistent=True)


def _quit(code: int) -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    if code:
        os._exit(code)
    # As a user does, so that what runs at the end is run too; unsaved changes are nobody's.
    bpy.ops.wm.quit_blender()


def main_window() -> Any:
    return bpy.context.window_manager.windows[0]


def view3d() -> Any:
    return next(area for area in main_window().screen.areas if area.type == "VIEW_3D")


def region(kind: str) -> Any:
    return next(region for region in view3d().regions if region.type == kind)


def in_view() -> Any:
    """Context of the 3D view, for operators that want one."""
    return bpy.context.temp_override(window=main_window(), area=view3d(), region=region("WINDOW"))


def click(x: float, y: float, *, ctrl: bool = False) -> None:
    """Press and let go the left button at a place of the window."""
    window = main_window()
    place = {"x": int(x), "y": int(y)}
    window.event_simulate(type="MOUSEMOVE", value="NOTHING", **place)
    window.event_simulate(type="LEFTMOUSE", value="PRESS", ctrl=ctrl, **place)
    window.event_simulate(type="LEFTMOUSE", value="RELEASE", ctrl=ctrl, **place)


def press(key: str) -> None:
    """Press and let go a key over the 3D view."""
    window, area = main_window(), view3d()
    place = {"x": area.x + area.width // 3, "y": area.y + area.height // 2}
    window.event_simulate(type="MOUSEMOVE", value="NOTHING", **place)
    window.event_simulate(type=key, value="PRESS", **place)
    window.event_simulate(type=key, value="RELEASE", **place)


def scroll(x: float, y: float, kind: str, *, ctrl: bool = False) -> None:
    window = main_window()
    window.event_simulate(type="MOUSEMOVE", value="NOTHING", x=int(x), y=int(y))
    window.event_simulate(type=kind, value="PRESS", x=int(x), y=int(y), ctrl=ctrl)


def open_tab() -> Iterator[float]:
    """Show the sidebar with our tab in front, as Ctrl and the mouse wheel do over the tabs."""
    view3d().spaces.active.show_region_ui = True
    yield 0.5
    for _ in range(20):
        bar = region("UI")
        if bar.active_panel_category == TAB:
            return
        scroll(bar.x + bar.width - 8, bar.y + bar.height - 40, "WHEELDOWNMOUSE", ctrl=True)
        yield 0.3
    raise AssertionError(f"no tab {TAB} in the sidebar")


def open_section(name: str) -> Iterator[float]:
    """Unfold one section and fold all others, as a Ctrl-click on a header does."""
    panels = [f"{_SECTION}{other}" for other in SECTIONS]
    place = [panel for panel in panels if hasattr(bpy.types, panel)].index(f"{_SECTION}{name}")
    bar = region("UI")
    x, top = bar.x + 60, bar.y + bar.height - 14
    click(x, top, ctrl=True)
    yield 0.5
    if place:
        click(x, top)
        yield 0.5
        click(x, top - place * _HEADER)
        yield 0.5


def shoot(name: str) -> Iterator[float]:
    """Draw everything, sections that slide as well, then keep the display's picture as PNG."""
    main_window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=4, y=4)
    for _ in range(4):
        for area in main_window().screen.areas:
            area.tag_redraw()
        yield 0.5
    write_png(Path(os.environ["WINDOW_SHOTS"]) / f"{name}.png", screen())


def screen() -> np.ndarray:
    """(H, W, 3) what the display shows, from Xvfb's XWD file: a header of 32-bit numbers, colour cells, pixels."""
    data = Path(os.environ["WINDOW_PICTURE"]).read_bytes()
    header = struct.unpack(">25I", data[:100])
    size, width, height, row, colours = header[0], header[4], header[5], header[12], header[19]
    start = size + 12 * colours
    pixels = np.frombuffer(data, np.uint8, row * height, start).reshape(height, row)
    return pixels[:, : 4 * width].reshape(height, width, 4)[..., 2::-1]


def sidebar_picture() -> np.ndarray:
    """The sidebar's part of the display; the window begins at its lower left corner."""
    bar, picture = region("UI"), screen()
    top = len(picture) - bar.y - bar.height
    return picture[top : top + bar.height, bar.x : bar.x + bar.width]


def write_png(path: Path, picture: np.ndarray) -> None:
    height, width, _ = picture.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), picture.reshape(height, -1)], axis=1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(rows.tobytes(), 9))
        + chunk(b"IEND", b"")
    )
