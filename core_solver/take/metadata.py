"""`Meta` and the people's small facts to JSON and back."""

import json
from dataclasses import asdict
from fractions import Fraction
from typing import Any

from core_solver.errors import TakeError
from core_solver.take.model import FORMAT, VERSION, CameraModel, Ground, Meta, Person

_KNOWN = frozenset({
    "format", "version", "frame_rate", "frame_range", "frame_step", "video", "camera", "gravity", "ground",
    "body_model", "body_licence", "joint_names", "parents", "people", "depth_source", "solver", "warnings",
})  # fmt: skip


def encode_meta(meta: Meta, people: tuple[Person, ...], frame_count: int) -> bytes:
    """UTF-8 JSON of the take's `meta` key; unknown entries of a file that was read come back unchanged.

    Raises:
        TakeError: the settings hold something that is not JSON.
    """
    last_frame = meta.first_frame + meta.frame_step * (frame_count - 1)
    document = {
        **meta.extra,
        "format": FORMAT,
        "version": VERSION,
        "frame_rate": [meta.frame_rate.numerator, meta.frame_rate.denominator],
        "frame_range": [meta.first_frame, last_frame],
        "frame_step": meta.frame_step,
        "video": {"name": meta.video_name, "width": meta.camera.width, "height": meta.camera.height},
        "camera": asdict(meta.camera),
        "gravity": list(meta.gravity),
        "ground": asdict(meta.ground),
        "body_model": meta.body_model,
        "body_licence": meta.body_licence,
        "joint_names": list(meta.joint_names),
        "parents": list(meta.parents),
        "people": [{"id": p.id, "name": p.name, "height_m": p.height_m, "colour": list(p.colour)} for p in people],
        "depth_source": meta.depth_source,
        "solver": {"preset": meta.preset, "version": meta.solver_version, "settings": meta.settings},
        "warnings": list(meta.warnings),
    }
    try:
        text = json.dumps(document, allow_nan=False, ensure_ascii=False)
    except (TypeError, ValueError) as error:
        raise TakeError(f"the take's meta entry cannot be written as JSON ({error})") from error
    # File names need not be Unicode: Python keeps their odd bytes as lone surrogates, which JSON can spell out.
    return text.encode(errors="backslashreplace")


def parse_document(raw: bytes) -> dict[str, Any]:
    """The JSON object of a take, checked for format and version.

    Raises:
        TakeError: not ours, newer than this program, or not JSON.
    """
    try:
        document = json.loads(raw.decode())
    except (ValueError, RecursionError) as error:
        raise TakeError("not a take: its meta entry is not readable JSON") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise TakeError("not a Scene-Aware Mocap take: write one with `scene-aware-mocap solve`")
    version = document.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise TakeError(f"take format version {version!r} is not a positive whole number: the file is damaged")
    if version > VERSION:
        raise TakeError(
            f"take format version {version} is newer than this program reads ({VERSION}): update Scene-Aware Mocap"
        )
    return document


def decode_meta(document: dict[str, Any]) -> Meta:
    """`Meta` from a checked JSON object.

    Raises:
        TakeError: an entry is missing or of the wrong kind.
    """
    try:
        camera = document["camera"]
        solver = document["solver"]
        numerator, denominator = (int(x) for x in document["frame_rate"])
        return Meta(
            frame_rate=Fraction(numerator, denominator),
            first_frame=int(document["frame_range"][0]),
            frame_step=int(document["frame_step"]),
            video_name=str(document["video"]["name"]),
            camera=_decode_camera(camera),
            gravity=_triple(document["gravity"]),
            ground=Ground(_triple(document["ground"]["normal"]), float(document["ground"]["offset"])),
            body_model=str(document["body_model"]),
            body_licence=str(document["body_licence"]),
            depth_source=str(document["depth_source"]),
            preset=str(solver["preset"]),
            solver_version=str(solver["version"]),
            settings=_kept(dict(solver["settings"])),
            warnings=tuple(str(w) for w in document["warnings"]),
            joint_names=tuple(str(n) for n in document["joint_names"]),
            parents=tuple(int(p) for p in document["parents"]),
            extra=_kept({key: value for key, value in document.items() if key not in _KNOWN}),
        )
    except (KeyError, TypeError, ValueError, IndexError, ArithmeticError) as error:
        raise TakeError(f"the take's meta entry is damaged ({type(error).__name__}: {error})") from error


def people_facts(document: dict[str, Any]) -> list[dict[str, Any]]:
    """The JSON objects of the people, one for each `people/I`.

    Raises:
        TakeError: the list is missing or holds something else.
    """
    people = document.get("people")
    if not isinstance(people, list) or not all(isinstance(facts, dict) for facts in people):
        raise TakeError("the take's list of people is damaged")
    return people


def _kept(facts: dict[str, Any]) -> dict[str, Any]:
    """Facts that are kept as they are; ValueError for numbers Python reads and JSON does not have: infinity, NaN."""
    json.dumps(facts, allow_nan=False)
    return facts


def _decode_camera(camera: dict[str, Any]) -> CameraModel:
    k1, k2, p1, p2, k3 = (float(x) for x in camera["distortion"])
    return CameraModel(
        width=int(camera["width"]),
        height=int(camera["height"]),
        fx=float(camera["fx"]),
        fy=float(camera["fy"]),
        cx=float(camera["cx"]),
        cy=float(camera["cy"]),
        distortion=(k1, k2, p1, p2, k3),
        source=str(camera.get("source", "")),
    )


def _triple(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
