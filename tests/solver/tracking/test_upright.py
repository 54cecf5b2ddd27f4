"""People who stand, lie, and stand on their heads: what the picture's rotation must have been."""

import numpy as np
import pytest

from core_solver.body.skeleton import KEYPOINT_NAMES
from core_solver.tracking.tracks import Modalities, Track
from core_solver.tracking.upright import describe_turned, turn_to_upright

FRAMES = 30
HEIGHTS = {"shoulder": 0.0, "hip": 60.0, "ankle": 150.0}


def standing(turn_degrees: float, confidence: float = 0.9) -> Track:
    """Somebody upright, whose picture was then turned anticlockwise."""
    down = np.array([HEIGHTS.get(name.rpartition("_")[2], 20.0) for name in KEYPOINT_NAMES])
    points = np.stack([np.random.default_rng(0).normal(0, 8, 25), down], axis=1)
    angle = np.radians(-turn_degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    keypoints = np.tile((points @ turn.T + 300).astype(np.float32), (FRAMES, 1, 1))
    sure = np.full((FRAMES, 25), confidence, np.float32)
    return Track(1, np.ones(FRAMES, bool), keypoints, sure, np.zeros((FRAMES, 25, 3), np.float32), 0.9)


def clip(*tracks: Track) -> Modalities:
    return Modalities(
        np.arange(FRAMES) / 25, np.arange(FRAMES), (640, 640), tracks, np.zeros((FRAMES, 4, 4), np.uint8), None
    )


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
@pytest.mark.parametrize("lean", [-30, 0, 30])
def test_the_turn_that_mends_is_named(turn: int, lean: int) -> None:
    seen = clip(standing(turn + lean), standing(turn))
    assert turn_to_upright(seen) == turn
    sentences = describe_turned(seen)
    assert ("".join(sentences).endswith(f"--rotate {turn}.")) == (turn != 0)


def test_one_who_lies_among_those_who_stand_is_no_reason() -> None:
    assert turn_to_upright(clip(standing(90), standing(0), standing(0))) == 0
    assert turn_to_upright(clip(standing(90), standing(0))) == 0


def test_who_is_hardly_seen_says_nothing() -> None:
    assert turn_to_upright(clip(standing(90, confidence=0.1))) == 0
    assert turn_to_upright(clip()) == 0
