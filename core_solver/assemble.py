"""A solution becomes a take."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_solver import __version__
from core_solver.body import BodyModel
from core_solver.camera import Camera
from core_solver.optimise.solution import Solution
from core_solver.take import Ground, Meta, Person, Scene, Take
from core_solver.tracking.tracks import Modalities, Track
from core_solver.video import VideoClip

# Colours that stay apart for colour-blind eyes (Okabe and Ito), sRGB.
PALETTE = (
    (0.90, 0.62, 0.00), (0.34, 0.71, 0.91), (0.00, 0.62, 0.45), (0.80, 0.47, 0.65),
    (0.94, 0.89, 0.26), (0.00, 0.45, 0.70), (0.84, 0.37, 0.00), (0.60, 0.60, 0.60),
)  # fmt: skip


@dataclass(frozen=True)
class Provenance:
    """How a take came about, for its meta entry.

    Attributes:
        depth_source: what gave depth.
        preset: solver preset.
        settings: JSON values.
        warnings: plain sentences.
    """

    depth_source: str
    preset: str
    settings: dict[str, Any]
    warnings: tuple[str, ...]


def assemble_take(
    modalities: Modalities, solution: Solution, camera: Camera, body: BodyModel, clip: VideoClip, scene: Scene,
    provenance: Provenance, steadying: NDArray[np.float64] | None = None,
) -> Take:  # fmt: skip
    """Everything a take holds, in its types; `steadying` as in `Take`."""
    normal, gravity = solution.ground.normal, solution.ground.gravity
    meta = Meta(
        frame_rate=clip.delivered_rate,
        first_frame=int(modalities.frames[0]),
        frame_step=clip.every,
        video_name=clip.path.name,
        camera=camera.as_model(),
        gravity=_unit(gravity),
        ground=Ground(_unit(normal), float(solution.ground.offset / np.linalg.norm(normal))),
        body_model=body.id,
        body_licence=body.licence,
        depth_source=provenance.depth_source,
        preset=provenance.preset,
        solver_version=__version__,
        settings=provenance.settings,
        warnings=provenance.warnings,
    )
    skinning = _four_weights(body.weights)
    people = tuple(_person(index, track, solution, body, skinning) for index, track in enumerate(modalities.tracks))
    return Take(meta, modalities.times.astype(np.float64), people, scene, steadying)


def _person(
    index: int,
    track: Track,
    solution: Solution,
    body: BodyModel,
    skinning: tuple[NDArray[np.uint8], NDArray[np.float32]],
) -> Person:
    betas, scale = solution.betas[index], float(solution.scales[index])
    return Person(
        id=track.id,
        name=track.name or f"Person {track.id}",
        height_m=round(scale * body.height(betas), 4),
        colour=person_colour(index),
        theta=solution.theta[index].astype(np.float32),
        gamma=solution.gamma[index].astype(np.float32),
        betas=betas.astype(np.float32),
        scale=scale,
        valid=track.valid.copy(),
        confidence=solution.confidence[index].astype(np.float32),
        contacts=solution.contacts[index].astype(np.float32),
        rest_joints=body.rest_joints(betas).astype(np.float32),
        rest_vertices=body.rest_vertices(betas).astype(np.float32),
        faces=body.faces.astype(np.int32),
        weight_joints=skinning[0],
        weights=skinning[1],
    )


def person_colour(index: int) -> tuple[float, float, float]:
    """The palette, then the same again in darker tones."""
    red, green, blue = PALETTE[index % len(PALETTE)]
    tone = 0.6 ** (index // len(PALETTE) % 3)
    return round(red * tone, 3), round(green * tone, 3), round(blue * tone, 3)


def _four_weights(weights: NDArray[np.float64]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """The four strongest joints of each vertex, which is what game engines take."""
    joints = np.argsort(-weights, axis=1, kind="stable")[:, :4]
    kept = np.take_along_axis(weights, joints, axis=1)
    return joints.astype(np.uint8), (kept / kept.sum(axis=1, keepdims=True)).astype(np.float32)


def _unit(vector: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in vector / np.linalg.norm(vector))
    return x, y, z
