"""Focal length as a distribution: a prior over ordinary lenses, and how well people and straight edges fit each."""

import logging
import math

import numpy as np
from numpy.typing import NDArray

from core_solver.camera import DEFAULT_FOV_DEGREES, CameraEstimate
from core_solver.camera_estimation.box_world import box_costs
from core_solver.camera_estimation.bystanders import gather_sights, look, pinhole
from core_solver.camera_estimation.one_ground import Fit, fit_world
from core_solver.optimise.threads import single_thread
from core_solver.tracking.tracks import Modalities

Array = NDArray[np.float64]

_log = logging.getLogger(__name__)

PRIOR_SIGMA = 0.25  # of log focal length: two thirds of all videos show 45 to 67 degrees along their longer side
_FINE = np.linspace(math.log(0.45), math.log(2.2), 61)  # log focal lengths, in longer sides: 96 to 26 degrees
_COARSE = _FINE[3:57:5]  # people say less, and asking them takes longer
_MOST_PEOPLE = 6  # those seen best: more cost time and say little new
_LEAST_SIGMA = 0.05  # lenses bend, and their centre is not quite the picture's


def assumed_camera(width: int, height: int) -> CameraEstimate:
    """An ordinary lens, where nothing is known."""
    return CameraEstimate(pinhole((width, height), _usual_focal(), "assumed field of view"), PRIOR_SIGMA)


def estimate_camera(modalities: Modalities) -> CameraEstimate:
    """Intrinsics from people of plausible height who stand on one ground, and from edges at right angles.

    Nearer people look larger, verticals converge, and bodies are seen from above by as much as their feet lie below the
    horizon: each ties the focal length to the camera's tilt. Rooms and streets, besides, are built of right angles.
    Where a clip shows nothing of that the answer is the assumed lens with the deviation of the prior.

    Args:
        modalities: tracks of at least one person, and straight edges if any were sought; an ideal lens with square
            pixels is assumed.
    """
    people, ups = _ask_people(modalities)
    edges = box_costs(modalities.edges, modalities.image_size, np.exp(_FINE), ups)
    log_focal, sigma = posterior(people + edges)
    who = "the people" if np.ptp(edges) < 1 else "the people and the scene's edges"
    camera = pinhole(modalities.image_size, math.exp(log_focal), f"estimated from {who}")
    _log.info("field of view estimated from %s: %.1f degrees, %.0f %%", who, camera.fov_degrees, 100 * sigma)
    return CameraEstimate(camera, sigma)


@single_thread()
def _ask_people(modalities: Modalities) -> tuple[Array, Array]:
    """Minus the log-likelihood of each focal length of `_FINE` (F,), and where up is with it (F, 3)."""
    sights = gather_sights(modalities, _MOST_PEOPLE)
    views = [look(sights, math.exp(focal)) for focal in _COARSE]
    last = len(views) - 1
    worlds: list[Fit | None] = [fit_world(view) if i in (0, last // 2, last) else None for i, view in enumerate(views)]
    # Neighbours begin where their neighbours ended, from both sides: the profile is one of the same world, not of many.
    for order, back in ((range(1, last + 1), -1), (range(last - 1, -1, -1), 1)):
        for i in order:
            here, other = worlds[i], fit_world(views[i], worlds[i + back])
            worlds[i] = other if here is None or other.cost < here.cost else here
    found = np.array([(world.cost, *world.up) for world in worlds if world is not None])
    cost, *up = (np.interp(_FINE, _COARSE, column) for column in found.T)
    ups = np.stack(up, axis=1)
    return cost, ups / np.linalg.norm(ups, axis=1, keepdims=True)


def posterior(costs: Array) -> tuple[float, float]:
    """Mean and deviation of log focal length (in longer sides), given minus the log-likelihood (61,) of `_FINE`."""
    log_chance = -costs - 0.5 * ((_FINE - math.log(_usual_focal())) / PRIOR_SIGMA) ** 2
    chance = np.exp(log_chance - log_chance.max())
    chance /= chance.sum()
    mean = float(chance @ _FINE)
    return mean, max(float(np.sqrt(chance @ (_FINE - mean) ** 2)), _LEAST_SIGMA)


def _usual_focal() -> float:
    return 0.5 / math.tan(math.radians(DEFAULT_FOV_DEGREES) / 2)
