"""Focal length from people, as a distribution: a prior over ordinary lenses, and how well people fit each of them."""

import logging
import math

import numpy as np
from numpy.typing import NDArray

from core_solver.camera import DEFAULT_FOV_DEGREES, CameraEstimate
from core_solver.camera_estimation.bystanders import gather_sights, look, pinhole
from core_solver.camera_estimation.one_ground import Fit, fit_world
from core_solver.optimise.threads import single_thread
from core_solver.tracking.tracks import Modalities

Array = NDArray[np.float64]

_log = logging.getLogger(__name__)

PRIOR_SIGMA = 0.25  # of log focal length: two thirds of all videos show 45 to 67 degrees along their longer side
_FOCALS = np.exp(np.linspace(math.log(0.5), math.log(1.9), 11))  # in longer sides: 90 to 29 degrees
_FINE = np.linspace(math.log(0.45), math.log(2.2), 400)
_MOST_PEOPLE = 6  # those seen best: more cost time and say little new
_LEAST_SIGMA = 0.05  # lenses bend, and their centre is not quite the picture's


def assumed_camera(width: int, height: int) -> CameraEstimate:
    """An ordinary lens, where nothing is known."""
    return CameraEstimate(pinhole((width, height), _usual_focal(), "assumed field of view"), PRIOR_SIGMA)


def estimate_camera(modalities: Modalities) -> CameraEstimate:
    """Intrinsics from people of plausible height who stand on one ground.

    Nearer people look larger, verticals converge, and bodies are seen from above by as much as their feet lie below the
    horizon: each ties the focal length to the camera's tilt. Where people show nothing of that the answer is the
    assumed lens with the deviation of the prior.

    Args:
        modalities: tracks of at least one person; an ideal lens with square pixels is assumed.
    """
    log_focal, sigma = posterior(focal_costs(modalities))
    camera = pinhole(modalities.image_size, math.exp(log_focal), "estimated from the people")
    _log.info("field of view estimated from people: %.1f degrees, %.0f %%", camera.fov_degrees, 100 * sigma)
    return CameraEstimate(camera, sigma)


@single_thread()
def focal_costs(modalities: Modalities) -> Array:
    """Minus the log-likelihood of each of the tried focal lengths."""
    sights = gather_sights(modalities, _MOST_PEOPLE)
    views = [look(sights, float(focal)) for focal in _FOCALS]
    last = len(views) - 1
    worlds: list[Fit | None] = [fit_world(view) if i in (0, last // 2, last) else None for i, view in enumerate(views)]
    # Neighbours begin where their neighbours ended, from both sides: the profile is one of the same world, not of many.
    for order, back in ((range(1, last + 1), -1), (range(last - 1, -1, -1), 1)):
        for i in order:
            here, other = worlds[i], fit_world(views[i], worlds[i + back])
            worlds[i] = other if here is None or other.cost < here.cost else here
    return np.array([world.cost for world in worlds if world is not None])


def posterior(costs: Array) -> tuple[float, float]:
    """Mean and deviation of log focal length (in longer sides), given minus the log-likelihood of `_FOCALS`."""
    likelihood = -np.interp(_FINE, np.log(_FOCALS), costs)
    prior = -0.5 * ((_FINE - math.log(_usual_focal())) / PRIOR_SIGMA) ** 2
    chance = np.exp(likelihood + prior - np.max(likelihood + prior))
    chance /= chance.sum()
    mean = float(chance @ _FINE)
    return mean, max(float(np.sqrt(chance @ (_FINE - mean) ** 2)), _LEAST_SIGMA)


def _usual_focal() -> float:
    return 0.5 / math.tan(math.radians(DEFAULT_FOV_DEGREES) / 2)
