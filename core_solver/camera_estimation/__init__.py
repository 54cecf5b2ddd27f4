"""The focal length of a camera nobody calibrated, from the people it shows."""

from core_solver.camera_estimation.estimate import assumed_camera, estimate_camera

__all__ = ["assumed_camera", "estimate_camera"]
