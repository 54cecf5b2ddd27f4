import time
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from core_solver.evaluation.perception_speed import Look, look_at_clip, main, table
from core_solver.perception.networks.declared import Declared
from core_solver.perception.perceive import Networks
from core_solver.video import VideoClip, open_video
from tests.solver.perception.people import demo_clip, standing_body, standing_pose
from tests.solver.test_video import write_video

FRAMES = 12


class Sleeper:
    """A network that always gives the same, after some milliseconds."""

    path = Path("sleeper")

    def __init__(self, milliseconds: float, answer: object) -> None:
        self.milliseconds, self.answer, self.calls = milliseconds, answer, 0

    def __call__(self, *_arguments: object) -> Any:
        self.calls += 1
        time.sleep(self.milliseconds / 1000)
        return self.answer


@pytest.fixture
def clip(tmp_path: Path) -> VideoClip:
    return open_video(write_video(tmp_path / "clip.avi", frames=FRAMES))


def test_each_network_and_the_whole_are_timed(clip: VideoClip) -> None:
    pose = standing_pose(100, 20)
    find, body = Sleeper(30, (pose,)), Sleeper(10, standing_body(pose))
    depth = Sleeper(20, np.zeros((4, 4), np.float16))
    declared = Declared(depth=cast("Any", depth))
    look = look_at_clip(clip, Networks(cast("Any", find), cast("Any", body), (), declared), 8)
    assert list(look.stages) == ["decoding", "people", "depth", "each person's body"]
    assert (look.frames, look.people) == (8, 1)
    for name, network in (("people", find), ("depth", depth), ("each person's body", body)):
        assert network.milliseconds <= look.stages[name] <= look.total_ms
        assert network.calls == 8 + 2  # the first ones warm it up and do not count
    # Both in one thread; what the warm-up took would make them longer than the whole.
    assert look.total_ms >= look.stages["people"] + look.stages["depth"]
    assert 0 < look.stages["decoding"] < look.total_ms
    assert look.peak_mb > 30


def test_the_users_own_networks_are_timed_too_and_decide(clip: VideoClip) -> None:
    nobody, masks = Sleeper(0, ()), Sleeper(10, ())
    declared = Declared(finder=cast("Any", nobody), masks=cast("Any", masks))
    unused = Sleeper(0, ())
    look = look_at_clip(clip, Networks(cast("Any", unused), cast("Any", unused), (), declared), 100)
    assert list(look.stages) == ["decoding", "people", "masks", "each person's body"]
    assert (look.frames, look.people) == (FRAMES, 0)
    assert look.stages["masks"] >= 10
    assert unused.calls == 0


def test_the_table_sets_both_clips_side_by_side() -> None:
    looks = [Look(n, 2.04, {"decoding": 1.0, "depth": 20.04}, 30.0, 500.4) for n in (25, 100)]
    assert [line.split()[-2:] for line in table(looks).splitlines()] == [
        ["25", "100"], ["1.0", "1.0"], ["20.0", "20.0"], ["30.0", "30.0"], ["2.0", "2.0"], ["500", "500"],
    ]  # fmt: skip
    assert len({len(line) for line in table(looks).splitlines()}) == 1


def test_bad_arguments_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "none.mp4")]) == 2
    assert capsys.readouterr().err.startswith("error: no video at")
    assert main([str(tmp_path / "none.mp4"), "--frames", "3"]) == 2
    assert "give 4 or more" in capsys.readouterr().err


@pytest.mark.models
def test_the_default_networks_on_the_demo_clip(models, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(demo_clip(models)), "--frames", "8", "--models-dir", str(models.models_dir)]) == 0
    rows = [line.rsplit(maxsplit=2) for line in capsys.readouterr().out.splitlines()]
    values = {name: (float(short), float(long)) for name, short, long in rows}
    assert values["frames"] == (2, 8)
    assert values["people a frame"] == (3, 3)
    assert min(values["people, ms a frame"]) > 1
    assert min(values["each person's body, ms a frame"]) > 1
