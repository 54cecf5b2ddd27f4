"""Scenes with exact truth: procedural or captured motion on solid scenery, seen as real networks would see it."""

from core_solver.evaluation.synthetic.noise import NoiseLevels
from core_solver.evaluation.synthetic.suites import SUITES, Suite, sized_scene, suite_scenes

__all__ = ["SUITES", "NoiseLevels", "Suite", "sized_scene", "suite_scenes"]
