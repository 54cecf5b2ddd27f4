"""Scenes that several tests look at."""

import pytest

from core_solver.body import BodyModel
from core_solver.evaluation.synthetic import suite_scenes
from core_solver.evaluation.truth import SyntheticScene
from tests.solver.body.synthetic import make_stick_body


@pytest.fixture(scope="session")
def stick() -> BodyModel:
    return make_stick_body()


@pytest.fixture(scope="session")
def scenes(stick: BodyModel) -> list[SyntheticScene]:
    """The standard suite's scenes of some seeds."""
    return [scene for seed in (3, 6) for scene in suite_scenes("standard", seed, stick)]
