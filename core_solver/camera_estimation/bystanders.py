"""What people show of the world when they are seen through a lens of a given focal length.

Landmarks are metres of an average body along each person's own viewing ray. A focal length turns these rays into
directions, so it decides where bodies stand, how far apart, and which way each of them leans.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import keypoint_index
from core_solver.camera import Camera
from core_solver.optimise.evidence import expect_shallow, gather_evidence, regressed_frames, turn_to_camera
from core_solver.optimise.placement import place
from core_solver.scene.contacts import still_feet
from core_solver.tracking.tracks import Modalities

Array = NDArray[np.float64]

_MOST_FRAMES = 40  # spread over the clip: more say nothing new
_PARTS = 6  # of the clip, in each of which a person's direction in the picture counts once
_SEEN = 0.2  # confidence of a keypoint that is used
_SAME_STEP_M = 0.05
_RARE_FOOT = 0.15  # share of the planted frames below which a foot says nothing about balance

_SOLES = [[keypoint_index(f"{side}_{part}") for part in ("heel", "toe")] for side in ("left", "right")]
_SHOULDERS, _HIPS, _KNEES, _ANKLES = (
    [keypoint_index(f"{side}_{part}") for side in ("left", "right")] for part in ("shoulder", "hip", "knee", "ankle")
)
_UPRIGHT = [*_SOLES[0], *_SOLES[1], *_SHOULDERS]
# Share of the body's mass near each group of keypoints, after the usual segment tables.
_MASS = (([keypoint_index("nose")], 0.12), (_SHOULDERS, 0.35), (_HIPS, 0.32), (_KNEES, 0.14), (_ANKLES, 0.07))


@dataclass(frozen=True)
class Sights:
    """N people in F frames, as they are in the picture.

    Attributes:
        image_size: (width, height) pixels.
        pixels: (N, F, 25, 2).
        confidence: (N, F, 25), 0 where not valid.
        landmarks: (N, F, 25, 3) metres of an average body as they are to be expected, z along the viewing ray.
        still: (N, F, 2) probability that a foot rests in the picture.
    """

    image_size: tuple[int, int]
    pixels: Array
    confidence: Array
    landmarks: Array
    still: Array


@dataclass(frozen=True)
class Bystanders:
    """The same people before a camera of known focal length, camera frame, metres of average bodies.

    Attributes:
        soles: (N, F, 2, 3) where each foot stands.
        planted: (N, F, 2) probability of being on the ground.
        balance: (N, 3) unit vectors from support to centre of mass; zeros where unknown.
        towards: (N, 3) unit vectors from the camera to the person.
        sideways: (N, P, 3) for each part of the clip, unit normal of the plane through camera, feet and shoulders:
            somebody upright has the vertical in that plane. Zeros where unknown.
        share: (N, P) of the part's frames in which the person was seen well.
    """

    soles: Array
    planted: Array
    balance: Array
    towards: Array
    sideways: Array
    share: Array


def gather_sights(modalities: Modalities, most_people: int) -> Sights:
    """The people seen best, in frames spread over the clip."""
    width, height = modalities.image_size
    any_camera = Camera(width, height, float(max(width, height)), float(max(width, height)), width / 2, height / 2)
    evidence = gather_evidence(modalities, any_camera)
    still = still_feet(evidence.pixels, evidence.confidence, evidence.size, evidence.times)
    worth = (evidence.confidence.sum(axis=(1, 2)) * np.median(evidence.size, axis=1)).argsort()[::-1]
    people = np.sort(worth[:most_people])
    count = len(modalities.times)
    frames = np.unique(np.linspace(0, count - 1, min(_MOST_FRAMES, count)).round().astype(int))
    landmarks = np.stack([modalities.tracks[n].landmarks.astype(float) for n in people])
    landmarks = np.nan_to_num(landmarks, nan=0.0, posinf=0.0, neginf=0.0)
    chosen = np.ix_(people, frames)
    regressed = regressed_frames(modalities.tracks)[chosen]
    return Sights(
        modalities.image_size,
        evidence.pixels[chosen],
        evidence.confidence[chosen],
        expect_shallow(landmarks[:, frames], regressed),
        still[chosen],
    )


def look(sights: Sights, focal: float) -> Bystanders:
    """People through a lens.

    Args:
        sights: what the picture shows.
        focal: length in longer sides of the picture.
    """
    camera = pinhole(sights.image_size, focal)
    landmarks = turn_to_camera(sights.landmarks, sights.pixels, camera)
    rays = camera.rays(sights.pixels)
    translation, good = place(landmarks, rays[..., :2], sights.confidence)
    good &= sights.confidence.sum(axis=-1) > 0
    points = landmarks + np.where(good, 1.0, 0.0)[..., None, None] * translation[:, :, None]
    soles = np.stack([points[:, :, side].mean(axis=2) for side in _SOLES], axis=2)
    planted = sights.still * good[..., None]
    towards = np.median(points[:, :, _HIPS].mean(axis=2), axis=1)
    sideways, share = _sideways(rays, good & (sights.confidence[..., _UPRIGHT].min(axis=-1) > _SEEN))
    return Bystanders(soles, planted, _balance(points, soles, planted), _unit(towards), sideways, share)


def pinhole(image_size: tuple[int, int], focal: float, source: str = "") -> Camera:
    """A camera with square pixels and the principal point in the middle; `focal` in longer sides of the picture."""
    width, height = image_size
    pixels = focal * max(width, height)
    return Camera(width, height, pixels, pixels, width / 2, height / 2, source=source)


def _balance(points: Array, soles: Array, planted: Array) -> Array:
    """Time-averaged directions (N, 3) from support to centre of mass: over a while nobody leans against nothing."""
    centre = np.sum([mass * points[:, :, group].mean(axis=2) for group, mass in _MASS], axis=0)
    directions = np.zeros((len(points), 3))
    for n in range(len(points)):
        up = _unit(np.median(points[n][:, _SHOULDERS].mean(axis=1) - soles[n].mean(axis=1), axis=0))
        # Of two still feet the lower one carries: a raised leg can be as still as a standing one.
        lower = soles[n] @ up
        carries = planted[n] * (lower < lower.min(axis=-1, keepdims=True) + _SAME_STEP_M)
        total = carries.sum(axis=0)
        if total.sum() >= 1:
            share = np.where(total > _RARE_FOOT * total.sum(), 1 / np.maximum(total, 1e-9), 0.0)
            directions[n] = _unit(np.einsum("tf,tfc,f->c", carries, centre[n][:, None] - soles[n], share))
    return directions


def _sideways(rays: Array, upright: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Normals (N, P, 3) and shares (N, P) of the clip's parts, from rays (N, F, 25, 3) in frames that show enough."""
    feet, shoulders = rays[:, :, [*_SOLES[0], *_SOLES[1]]].mean(axis=2), rays[:, :, _SHOULDERS].mean(axis=2)
    normals = _unit(np.cross(feet, shoulders))
    people, frames = upright.shape
    edges = np.linspace(0, frames, _PARTS + 1).round().astype(int)
    means, share = np.zeros((people, _PARTS, 3)), np.zeros((people, _PARTS))
    for n in range(people):
        for part in range(_PARTS):
            frame = slice(edges[part], edges[part + 1])
            seen = upright[n, frame]
            if seen.any():
                means[n, part] = _unit(np.median(normals[n, frame][seen], axis=0))
                share[n, part] = seen.mean()
    return means, share


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
