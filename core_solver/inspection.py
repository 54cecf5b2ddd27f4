"""What is in a take, as facts for programs and as a table for people."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_solver.camera import camera_from_model
from core_solver.take import FORMAT, VERSION, Person, Take

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class PersonFacts:
    """One person.

    Attributes:
        id: stable over the clip.
        name: shown to the user.
        height_m: metres.
        colour: red, green, blue in [0, 1].
        frames_seen: frames with evidence; the others are filled.
        first_frame: frame of the take of the first sight, None if never seen.
        last_frame: of the last sight.
        position_min: lowest x, y, z of the root over the frames seen, metres, camera frame.
        position_max: highest.
    """

    id: int
    name: str
    height_m: float
    colour: Triple
    frames_seen: int
    first_frame: int | None
    last_frame: int | None
    position_min: Triple | None
    position_max: Triple | None


@dataclass(frozen=True)
class CameraFacts:
    """Intrinsics in pixels, and the camera's place above the ground in metres."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...]
    fov_degrees: float
    source: str
    height_above_ground_m: float


@dataclass(frozen=True)
class TakeFacts:
    """A take in numbers and words: the keys of `inspect --json`, which stay."""

    file: str
    file_size_bytes: int
    format: str
    format_version: int
    solver_version: str
    preset: str
    video: str
    frame_count: int
    first_video_frame: int
    frame_step: int
    frames_per_second: float
    duration_s: float
    camera: CameraFacts
    depth_source: str
    body_model: str
    body_licence: str
    people: tuple[PersonFacts, ...]
    scene_points: int
    position_min: Triple | None
    position_max: Triple | None
    warnings: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Plain values for `json.dumps`."""
        return asdict(self)


def take_facts(take: Take, path: Path) -> TakeFacts:
    """The facts of a take that was read from `path`."""
    meta, camera = take.meta, camera_from_model(take.meta.camera)
    seen_roots = [_seen_roots(person) for person in take.people]
    low, high = _bounds(np.concatenate(seen_roots)) if seen_roots else (None, None)
    return TakeFacts(
        file=str(path),
        file_size_bytes=path.stat().st_size,
        format=FORMAT,
        format_version=VERSION,
        solver_version=meta.solver_version,
        preset=meta.preset,
        video=meta.video_name,
        frame_count=take.frame_count,
        first_video_frame=meta.first_frame,
        frame_step=meta.frame_step,
        frames_per_second=round(float(meta.frame_rate), 4),
        duration_s=round(float(take.times[-1] - take.times[0]), 4),
        camera=CameraFacts(
            **{name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy", "source")},
            distortion=tuple(camera.distortion),
            fov_degrees=round(camera.fov_degrees, 2),
            height_above_ground_m=round(meta.ground.offset, 3),
        ),
        depth_source=meta.depth_source,
        body_model=meta.body_model,
        body_licence=meta.body_licence,
        people=tuple(_person_facts(person, roots) for person, roots in zip(take.people, seen_roots, strict=True)),
        scene_points=len(take.scene.points),
        position_min=low,
        position_max=high,
        warnings=tuple(meta.warnings),
    )


def describe(facts: TakeFacts) -> Iterator[str]:
    """Lines for people."""
    camera = facts.camera
    yield f"{facts.file}  ({facts.file_size_bytes / 1e6:.1f} MB, {facts.format} version {facts.format_version})"
    yield (
        f"  video    {facts.video}, from frame {facts.first_video_frame}: {facts.frame_count} frames "
        f"at {facts.frames_per_second:g} per second, {facts.duration_s:.2f} s"
    )
    yield (
        f"  camera   {camera.width}x{camera.height}, field of view {camera.fov_degrees:.1f} degrees "
        f"({camera.source}), {camera.height_above_ground_m:.2f} m above the ground"
    )
    yield f"  depth    {facts.depth_source}"
    yield f"  scene    {facts.scene_points} points"
    yield f"  body     {facts.body_model} ({facts.body_licence})"
    yield f"  solver   {facts.solver_version}, preset {facts.preset}"
    yield from describe_people(facts)
    for warning in facts.warnings:
        yield f"  warning  {warning}"


def describe_people(facts: TakeFacts) -> Iterator[str]:
    """The table of people."""
    if not facts.people:
        yield "  people   nobody"
        return
    width = max(4, *(len(person.name) for person in facts.people))
    yield f"  {'id':>3}  {'name':<{width}}  height  frames seen  first  last  distance from camera"
    for person in facts.people:
        yield (
            f"  {person.id:>3}  {person.name:<{width}}  {person.height_m:4.2f} m  "
            f"{f'{person.frames_seen} of {facts.frame_count}':>11}  {_dash(person.first_frame):>5}  "
            f"{_dash(person.last_frame):>4}  {_distance(person)}"
        )


def _person_facts(person: Person, seen_roots: NDArray[np.float64]) -> PersonFacts:
    seen = np.flatnonzero(person.valid)
    low, high = _bounds(seen_roots)
    return PersonFacts(
        id=person.id,
        name=person.name,
        height_m=round(person.height_m, 4),
        colour=person.colour,
        frames_seen=len(seen),
        first_frame=int(seen[0]) if seen.size else None,
        last_frame=int(seen[-1]) if seen.size else None,
        position_min=low,
        position_max=high,
    )


def _seen_roots(person: Person) -> NDArray[np.float64]:
    """(n, 3) pelvis in the frames in which the person was seen: FK leaves the root at its rest place."""
    return (person.gamma[person.valid] + person.scale * person.rest_joints[0]).astype(float)


def _bounds(points: NDArray[np.float64]) -> tuple[Triple, Triple] | tuple[None, None]:
    if len(points) == 0:
        return None, None
    return _rounded(points.min(axis=0)), _rounded(points.max(axis=0))


def _rounded(point: NDArray[np.float64]) -> Triple:
    x, y, z = (round(float(v), 3) for v in point)
    return x, y, z


def _dash(value: int | None) -> str:
    return "-" if value is None else str(value)


def _distance(person: PersonFacts) -> str:
    if person.position_min is None or person.position_max is None:
        return "-"
    return f"{person.position_min[2]:.1f} to {person.position_max[2]:.1f} m"
