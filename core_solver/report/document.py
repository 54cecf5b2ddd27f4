"""The content of the page: what its script reads, as dataclasses that become JSON, and the block of arrays."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from core_solver.camera import camera_from_model
from core_solver.geometry import Similarity, world_from_camera
from core_solver.report.evidence import Reprojection
from core_solver.report.findings import Finding, find_all
from core_solver.report.footage import Footage
from core_solver.report.measures import PersonMeasures, ground_frame, measure_person
from core_solver.report.packing import PackedArray, Packer
from core_solver.scene.thinning import thin_evenly
from core_solver.take import Person, Take

_CLOUD_POINTS = 60_000
_FAR_SHARE = 0.995  # of the cloud lies nearer than what is shown: single points far out would coarsen all others


@dataclass(frozen=True)
class PageCamera:
    """Intrinsics, and the pose in the world: camera = rotation @ (world - place)."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...]
    rotation: tuple[float, ...]
    place: tuple[float, ...]


@dataclass(frozen=True)
class PageMesh:
    """What people of the same body model share: faces (F, 3), joints (V, 4) and their weights (V, 4) of 255."""

    faces: PackedArray
    joints: PackedArray
    weights: PackedArray


@dataclass(frozen=True)
class PagePerson:
    """One person; arrays as in `PersonMeasures`, the rest pose in metres with the person's scale applied."""

    id: int
    name: str
    colour: tuple[float, float, float]
    height_m: float
    seen: float
    mesh: int
    rest_vertices: PackedArray
    rest_joints: PackedArray
    joints: PackedArray
    turns: PackedArray
    valid: PackedArray
    contacts: PackedArray
    top: PackedArray
    lowest: PackedArray
    confidence: PackedArray
    skate: PackedArray
    reprojection: PackedArray | None


@dataclass(frozen=True)
class PageFootage:
    """JPEG files one after the other: picture i shows frame `frames[i]` and ends where the next begins."""

    width: int
    height: int
    frames: tuple[int, ...]
    starts: tuple[int, ...]
    data: PackedArray


@dataclass(frozen=True)
class PageDocument:
    """Everything. Sentences that say why something is missing are None where it is there."""

    title: str
    facts: tuple[tuple[str, str], ...]
    findings: tuple[Finding, ...]
    first_frame: int
    frame_step: int
    times: PackedArray
    parents: tuple[int, ...]
    joint_names: tuple[str, ...]
    camera: PageCamera
    meshes: tuple[PageMesh, ...]
    people: tuple[PagePerson, ...]
    points: PackedArray
    colours: PackedArray
    footage: PageFootage | None
    no_footage: str | None
    no_reprojection: str | None

    def as_json(self) -> dict[str, Any]:
        """Plain values for `json.dumps`."""
        return asdict(self)


def build_document(
    take: Take, footage: Footage | str, reprojection: Reprojection | str, packer: Packer
) -> PageDocument:
    """Measure a take and collect all that the page shows.

    Args:
        take: the take.
        footage: its pictures, or a sentence that says why there are none.
        reprojection: how bodies lie over what was seen, or a sentence that says why that is not known.
        packer: takes the arrays.
    """
    ground = ground_frame(take)
    to_world = world_from_camera(ground)
    measures = [measure_person(person, take.meta.joint_names, ground) for person in take.people]
    seen = reprojection if isinstance(reprojection, Reprojection) else None
    mesh_numbers, meshes = _meshes(take.people, packer)
    points, colours = _cloud(take, to_world)
    return PageDocument(
        title=take.meta.video_name,
        facts=_facts(take),
        findings=find_all(take, measures, seen),
        first_frame=take.meta.first_frame,
        frame_step=take.meta.frame_step,
        times=packer.plain(take.times, "float64"),
        parents=take.meta.parents,
        joint_names=take.meta.joint_names,
        camera=_camera(take, to_world),
        meshes=meshes,
        people=tuple(
            _person(person, measured, mesh_numbers[index], None if seen is None else seen.pixels[index], packer)
            for index, (person, measured) in enumerate(zip(take.people, measures, strict=True))
        ),
        points=packer.quantised(points, by_column=True),
        colours=packer.plain(colours, "uint8"),
        footage=_footage(footage, packer) if isinstance(footage, Footage) else None,
        no_footage=footage if isinstance(footage, str) else None,
        no_reprojection=reprojection if isinstance(reprojection, str) else None,
    )


def _facts(take: Take) -> tuple[tuple[str, str], ...]:
    meta, camera = take.meta, camera_from_model(take.meta.camera)
    rate, last = float(meta.frame_rate), meta.first_frame + meta.frame_step * (take.frame_count - 1)
    duration = float(take.times[-1] - take.times[0]) + 1 / rate
    return (
        ("People", str(len(take.people))),
        ("Frames", f"{meta.first_frame}-{last}" + (f", every {meta.frame_step}." if meta.frame_step > 1 else "")),
        ("Length", f"{duration:.2f} s at {rate:g} a second"),
        ("Camera", f"{camera.fov_degrees:.0f}\N{DEGREE SIGN} wide, {meta.ground.offset:.2f} m above the ground"),
        ("Lens from", camera.source or "unknown"),
        ("Depth from", meta.depth_source),
        ("Body", meta.body_model),
        ("Solver", f"{meta.solver_version}, preset {meta.preset}"),
    )


def _camera(take: Take, to_world: Similarity) -> PageCamera:
    model = take.meta.camera
    return PageCamera(
        **{name: getattr(model, name) for name in ("width", "height", "fx", "fy", "cx", "cy")},
        distortion=tuple(model.distortion),
        rotation=tuple(float(x) for x in to_world.rotation.T.ravel()),
        place=tuple(float(x) for x in to_world.translation),
    )


def _meshes(people: Sequence[Person], packer: Packer) -> tuple[list[int], tuple[PageMesh, ...]]:
    """Each person's mesh; people of one body model share theirs."""
    known: dict[bytes, int] = {}
    meshes, numbers = [], []
    for person in people:
        key = b"".join(a.tobytes() for a in (person.faces, person.weight_joints, person.weights))
        if key not in known:
            known[key] = len(meshes)
            meshes.append(_mesh(person, packer))
        numbers.append(known[key])
    return numbers, tuple(meshes)


def _mesh(person: Person, packer: Packer) -> PageMesh:
    small = len(person.rest_vertices) < 1 << 16
    return PageMesh(
        faces=packer.plain(person.faces, "uint16" if small else "uint32"),
        joints=packer.plain(person.weight_joints, "uint8"),
        weights=packer.plain(np.round(255 * person.weights.clip(0, 1)), "uint8"),
    )


def _person(
    person: Person, measured: PersonMeasures, mesh: int, reprojection: np.ndarray | None, packer: Packer
) -> PagePerson:
    return PagePerson(
        id=person.id,
        name=person.name,
        colour=person.colour,
        height_m=person.height_m,
        seen=float(person.valid.mean()),
        mesh=mesh,
        rest_vertices=packer.quantised(person.scale * person.rest_vertices, by_column=True),
        rest_joints=packer.plain(person.scale * person.rest_joints, "float32"),
        joints=packer.quantised(measured.joints, by_column=True),
        turns=packer.plain(np.round(32767 * measured.turns), "int16"),
        valid=packer.plain(person.valid, "uint8"),
        contacts=packer.plain(np.round(255 * person.contacts.clip(0, 1)), "uint8"),
        top=packer.quantised(measured.top),
        lowest=packer.quantised(measured.lowest),
        confidence=packer.quantised(measured.confidence),
        skate=packer.quantised(measured.skate),
        reprojection=None if reprojection is None else packer.quantised(reprojection),
    )


def _cloud(take: Take, to_world: Similarity) -> tuple[np.ndarray, np.ndarray]:
    """(P, 3) metres in the world and (P, 3) colours, few enough to be drawn at every frame."""
    points, colours = take.scene.points, take.scene.colors
    if len(points):
        distance = np.linalg.norm(points, axis=1)
        near = distance <= np.quantile(distance, _FAR_SHARE)
        points, colours = points[near], colours[near]
    kept = thin_evenly(points, _CLOUD_POINTS)
    return to_world.apply(points[kept]), colours[kept]


def _footage(footage: Footage, packer: Packer) -> PageFootage:
    starts = np.cumsum([0, *(len(picture) for picture in footage.pictures)])
    return PageFootage(
        width=footage.width,
        height=footage.height,
        frames=footage.frames,
        starts=tuple(int(s) for s in starts),
        data=packer.plain(np.frombuffer(b"".join(footage.pictures), np.uint8), "uint8"),
    )
