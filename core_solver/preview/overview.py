"""One picture to judge a take by: frames with overlay, the scene from above, feet against the ground, heights."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.camera import camera_from_model
from core_solver.errors import UserError
from core_solver.geometry import GroundFrame, world_from_camera
from core_solver.preview.bodies import PosablePerson
from core_solver.preview.overlay import TakeOverFootage
from core_solver.preview.panel import Panel, Range
from core_solver.preview.text import WHITE, draw_plain_text
from core_solver.progress import Advance
from core_solver.take import Take

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

_WIDTH, _MAX_FRAME_HEIGHT, _HEADER = 1920, 620, 48
_TOP_VIEW_WIDTH, _CHART_HEIGHT = 1120, 820
_PAPER = (250, 249, 248)
_CAMERA = (90, 80, 70)
_VIEW = (246, 240, 232)
_GROUND = (120, 160, 120)
_PICTURES = 4
_MIN_BARS = 4  # fewer people do not get fatter
_FEET_SAMPLES = 120
_FEET_RANGE = (-0.2, 0.5)  # metres shown at least
_FADE = 0.45  # share of white in the cloud's colours
_CEILING = 3.0  # metres: higher points would hide the scene from above
_MARGIN = 1.0  # metres around the people in the top view


@dataclass(frozen=True)
class _World:
    """A take in its world frame (z up, metres, origin on the ground below the camera).

    Attributes:
        times: (T,) seconds.
        people: the bodies.
        roots: per person (T, 3) pelvis.
        valid: per person (T,).
        feet: per person (n,) height of the lowest vertex at the sampled frames.
        samples: (n,) frames sampled.
        camera_place: (3,).
        view: (2, 3) unit directions along the left and right edge of the picture.
        cloud: (P, 3).
        cloud_colours: (P, 3) BGR.
    """

    times: Array
    people: list[PosablePerson]
    roots: list[Array]
    valid: list[NDArray[np.bool_]]
    feet: list[Array]
    samples: NDArray[np.int64]
    camera_place: Array
    view: Array
    cloud: Array
    cloud_colours: Image


def write_overview(footage: TakeOverFootage, path: Path, advance: Advance) -> None:
    """Draw and write the overview as PNG.

    Raises:
        UserError: the picture cannot be written there; an older file stays.
    """
    canvas = draw_overview(footage, advance)
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        fine, data = cv2.imencode(path.suffix, canvas)
        if fine:
            part.write_bytes(data.tobytes())
            part.replace(path)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}; choose another place with -o") from error
    finally:
        part.unlink(missing_ok=True)


def draw_overview(footage: TakeOverFootage, advance: Advance) -> Image:
    """The overview as a BGR picture."""
    frames = _spread_frames(footage.take.frame_count)
    strip = _picture_strip(footage, frames, advance)
    top = _HEADER + strip.shape[0]
    canvas = np.full((top + _CHART_HEIGHT, _WIDTH, 3), _PAPER, np.uint8)
    _draw_header(canvas, footage.take)
    canvas[_HEADER:top] = strip
    world = _in_world(footage.take)
    _draw_top_view(canvas, (0, top, _TOP_VIEW_WIDTH, top + _CHART_HEIGHT), world)
    middle = top + _CHART_HEIGHT // 2
    _draw_feet(canvas, (_TOP_VIEW_WIDTH, top, _WIDTH, middle), world)
    _draw_heights(canvas, (_TOP_VIEW_WIDTH, middle, _WIDTH, top + _CHART_HEIGHT), world)
    return canvas


def _spread_frames(count: int) -> list[int]:
    """Up to four different frames, spread over the take."""
    return sorted({round((i + 0.5) * (count - 1) / _PICTURES) for i in range(_PICTURES)})


def _picture_strip(footage: TakeOverFootage, frames: list[int], advance: Advance) -> Image:
    cell_width = _WIDTH // _PICTURES
    scale = min(cell_width / footage.camera.width, _MAX_FRAME_HEIGHT / footage.camera.height)
    size = max(1, round(footage.camera.width * scale)), max(1, round(footage.camera.height * scale))
    strip = np.full((size[1] + 8, _WIDTH, 3), _PAPER, np.uint8)
    for slot, picture in enumerate(footage.pictures(frames)):
        left = slot * cell_width + (cell_width - size[0]) // 2
        strip[4 : 4 + size[1], left : left + size[0]] = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        advance(1)
    return strip


def _draw_header(canvas: Image, take: Take) -> None:
    camera = camera_from_model(take.meta.camera)
    people = "1 person" if len(take.people) == 1 else f"{len(take.people)} people"
    facts = (
        f"{take.meta.video_name}   {people}   {take.frame_count} frames, {take.times[-1] - take.times[0]:.1f} s   "
        f"field of view {camera.fov_degrees:.0f} deg ({camera.source})   depth: {take.meta.depth_source}"
    )
    draw_plain_text(canvas, facts.encode("ascii", "replace").decode(), (16, 31), 0.6)


def _in_world(take: Take) -> _World:
    meta = take.meta
    ground = GroundFrame(np.array(meta.gravity), np.array(meta.ground.normal), meta.ground.offset)
    to_world = world_from_camera(ground)
    camera = camera_from_model(meta.camera)
    people = [PosablePerson(person) for person in take.people]
    samples = np.unique(np.linspace(0, take.frame_count - 1, _FEET_SAMPLES).astype(np.int64))
    edges = camera.rays([[0, camera.height / 2], [camera.width, camera.height / 2]]) @ to_world.rotation.T
    return _World(
        times=take.times,
        people=people,
        roots=[to_world.apply(p.joints()[:, 0]) for p in people],
        valid=[p.person.valid for p in people],
        feet=[np.array([ground.height_above(p.vertices(int(t))).min() for t in samples]) for p in people],
        samples=samples,
        camera_place=to_world.translation,
        view=edges / np.linalg.norm(edges, axis=1, keepdims=True),
        cloud=to_world.apply(take.scene.points),
        cloud_colours=take.scene.colors[:, ::-1],
    )


def _draw_top_view(canvas: Image, box: tuple[int, int, int, int], world: _World) -> None:
    places = np.concatenate([world.camera_place[None], *world.roots])[:, :2]
    low, high = places.min(axis=0) - _MARGIN, places.max(axis=0) + _MARGIN
    panel = Panel(canvas, box, Range(low[0], high[0]), Range(low[1], high[1]), equal=True)
    panel.title("From above (world frame, camera looks up the page)")
    _draw_view_wedge(panel, world)
    _draw_cloud(panel, world)
    panel.grid("metres", "metres away")
    _draw_camera(panel, world.camera_place)
    for person, roots, valid in zip(world.people, world.roots, world.valid, strict=True):
        _draw_path(panel, roots[:, :2], valid, person)
    panel.frame()


def _draw_view_wedge(panel: Panel, world: _World) -> None:
    reach = 2 * (panel.across.span + panel.up.span)
    eye = world.camera_place[:2]
    panel.area(np.stack([eye, *(eye + reach * world.view[:, :2])]), _VIEW)
    for edge in world.view:
        panel.line([eye, eye + reach * edge[:2]], (214, 200, 184))


def _draw_cloud(panel: Panel, world: _World) -> None:
    shown = world.cloud[:, 2] < _CEILING
    order = np.argsort(world.cloud[shown, 2], kind="stable")
    colours = world.cloud_colours[shown][order].astype(float) * (1 - _FADE) + 255 * _FADE
    panel.dots(world.cloud[shown][order, :2], colours.astype(np.uint8))


def _draw_camera(panel: Panel, place: Array) -> None:
    u, v = place[:2]
    size = 0.012 * (panel.across.span + panel.up.span)
    panel.area([(u, v), (u - 0.6 * size, v + size), (u + 0.6 * size, v + size)], _CAMERA)
    panel.disc((u, v), 6, _CAMERA)
    panel.text(f"camera, {place[2]:.2f} m high", (u, v), (12, 6))


def _draw_path(panel: Panel, path: Array, valid: NDArray[np.bool_], person: PosablePerson) -> None:
    """Thick where the person was seen, thin where filled, nothing before the first and after the last sight."""
    seen = np.flatnonzero(valid)
    if seen.size == 0:
        return
    panel.line(path[seen[0] : seen[-1] + 1], person.colour, 1)
    for run in np.split(seen, np.flatnonzero(np.diff(seen) > 1) + 1):
        panel.line(path[run], person.colour, 3)
    start, stop = path[seen[0]], path[seen[-1]]
    panel.disc(start, 6, person.colour, hollow=True)
    panel.disc(stop, 7, person.colour)
    panel.text(person.label, stop, (12, -6))


def _draw_feet(canvas: Image, box: tuple[int, int, int, int], world: _World) -> None:
    heights = [feet for feet in world.feet if feet.size]
    low = min([_FEET_RANGE[0], *(float(f.min()) for f in heights)])
    high = max([_FEET_RANGE[1], *(float(f.max()) for f in heights)])
    first, last = float(world.times[0]), float(world.times[-1])
    panel = Panel(canvas, box, Range(first, max(last, first + 0.1)), Range(low - 0.02, high + 0.02), equal=False)
    panel.title("Feet against the ground: lowest point of each body")
    panel.grid("seconds", "metres above ground")
    panel.line([(panel.across.low, 0), (panel.across.high, 0)], _GROUND, 2)
    times = world.times[world.samples]
    for person, feet, valid in zip(world.people, world.feet, world.valid, strict=True):
        seen = np.flatnonzero(valid[world.samples])
        for run in np.split(seen, np.flatnonzero(np.diff(seen) > 1) + 1) if seen.size else []:
            panel.line(np.stack([times[run], feet[run]], axis=-1), person.colour, 2)
    panel.frame()


def _draw_heights(canvas: Image, box: tuple[int, int, int, int], world: _World) -> None:
    tallest = max([1.9, *(p.person.height_m for p in world.people)])
    places = max(len(world.people), _MIN_BARS)
    panel = Panel(canvas, box, Range(-0.6, places - 0.4), Range(0, tallest * 1.2), equal=False)
    panel.title("Heights, and share of frames in which each was seen")
    panel.grid("", "metres")
    for place, person in enumerate(world.people):
        height, seen = person.person.height_m, float(person.person.valid.mean())
        left, right = place - 0.25, place + 0.25
        panel.area([(left, 0), (right, 0), (right, height), (left, height)], person.colour)
        panel.text(f"{height:.2f} m", (left, height), (2, -8))
        panel.text(f"{person.person.id}: {seen:.0%}", (left, 0), (2, -8), WHITE)
    panel.frame()
