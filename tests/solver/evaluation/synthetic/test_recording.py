"""BVH files: reading against a hand-made one, and feet that rest when they are replayed."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.body import BodyModel
from core_solver.body.skeleton import keypoint_index
from core_solver.errors import UserError
from core_solver.evaluation.synthetic.bvh import read_bvh
from core_solver.evaluation.synthetic.physique import draw_physique
from core_solver.evaluation.synthetic.recording import read_recordings
from core_solver.evaluation.synthetic.replay import Replay, replay
from tests.solver.evaluation.synthetic.test_motion import soles_of

TINY = """HIERARCHY
ROOT Hip
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Knee
  {
    OFFSET 0 -2 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 -1 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.5
1 2 3 0 0 0 0 0 0
1 2 3 90 0 90 0 90 0
"""
SIDE = (("{s}UpLeg", "{x} -0.1 0"), ("{s}Leg", "0 -4 0"), ("{s}Foot", "0 -4 0"), ("{s}ToeBase", "0 -0.5 1.5"))
ARM = (("{s}Arm", "{x} 5 0"), ("{s}ForeArm", "{y} 0 0"), ("{s}Hand", "{y} 0 0"))
ROOT = (0, 8.6, 0, 0, 0, 0)
UPRIGHT, LYING = (" ".join(f"{v:.6f}" for v in root) for root in (ROOT, (0, 0, 8.6, 0, 0, 90)))


def chain(parts: tuple, side: str, sign: int) -> str:
    if not parts:
        return "End Site\n{\nOFFSET 0 0 1\n}\n"
    (name, offset), *rest = parts
    offset = offset.format(x=sign, y=3 * sign)
    below = chain(tuple(rest), side, sign)
    return f"JOINT {name.format(s=side)} {{ OFFSET {offset} CHANNELS 3 Zrotation Yrotation Xrotation\n{below}}}\n"


def walking_bvh(frames: int = 90) -> str:
    """A stiff-legged walk of a Mixamo-like skeleton whose left foot rests in the first half and the right one later."""
    limbs = "".join(chain(parts, side, sign) for parts in (SIDE, ARM) for side, sign in (("Left", 1), ("Right", -1)))
    head = "HIERARCHY ROOT Hips { OFFSET 0 0 0 CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation\n"
    rows = []
    for t in range(frames):
        swing = 12 * np.sin(2 * np.pi * t / frames)
        angles = np.zeros((14, 3))
        angles[0, 2], angles[4, 2] = swing, -swing
        rows.append(" ".join(f"{v:.6f}" for v in (*ROOT, *angles.ravel())))
    return f"{head}{limbs}}}\nMOTION\nFrames: {frames}\nFrame Time: 0.0333333\n" + "\n".join(rows) + "\n"


def test_a_tiny_file_means_what_it_says(tmp_path: Path) -> None:
    (tmp_path / "tiny.bvh").write_text(TINY)
    motion = read_bvh(tmp_path / "tiny.bvh")
    assert motion.names == ("Hip", "Knee")
    assert motion.parents == (-1, 0)
    assert motion.frame_seconds == 0.5
    np.testing.assert_allclose(motion.positions[0], [[1, 2, 3], [1, 0, 3]])
    # Z then Y by 90 degrees: the bone along -y turns to +x, which the later turn about the joint's own y leaves alone.
    np.testing.assert_allclose(motion.positions[1], [[1, 2, 3], [3, 2, 3]], atol=1e-12)
    # Rotations apply in the order of the channels: R = Rz(90) Ry(90) of the hip, then Rx(90) of the knee.
    z, y, x = (
        np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
        np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
        np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
    )
    np.testing.assert_allclose(motion.rotations[1, 1], z @ y @ x, atol=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "", "HIERARCHY", "MOTION", TINY[:300], TINY.replace("90", "nan"), TINY.replace("Frames: 2", "Frames: 3"),
        TINY.replace("Zrotation", "Qrotation"),
    ],
)  # fmt: skip
def test_damaged_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.bvh").write_text(text)
    with pytest.raises(UserError, match=r"bad\.bvh"):
        read_bvh(tmp_path / "bad.bvh")


@given(st.integers(0, len(TINY) - 1), st.text(max_size=4))
def test_no_file_breaks_the_reader(tmp_path_factory: pytest.TempPathFactory, place: int, junk: str) -> None:
    path = tmp_path_factory.getbasetemp() / "junk.bvh"
    path.write_text(TINY[:place] + junk + TINY[place + 2 :], encoding="utf-8")
    try:
        positions = read_bvh(path).positions
    except UserError:
        return
    assert np.isfinite(positions).all()


def test_unknown_skeletons_and_empty_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"no \.bvh files"):
        read_recordings(tmp_path)
    (tmp_path / "tiny.bvh").write_text(TINY)
    with pytest.raises(UserError, match="names its joints"):
        read_recordings(tmp_path)


@pytest.mark.parametrize("turned", [False, True])
def test_recordings_stand_upright_and_are_as_long_as_legs(tmp_path: Path, turned: bool) -> None:
    text = walking_bvh()
    if turned:  # the same figure lying along the file's z axis
        text = text.replace(UPRIGHT, LYING)
        assert LYING in text
    (tmp_path / "walk.bvh").write_text(text)
    (recording,) = read_recordings(tmp_path)
    hip, knee, ankle = (recording.keypoints[:, keypoint_index(f"left_{part}")] for part in ("hip", "knee", "ankle"))
    assert recording.length == pytest.approx(88 * 0.0333333)
    np.testing.assert_allclose(np.linalg.norm(hip - knee, axis=1) + np.linalg.norm(knee - ankle, axis=1), 1)
    assert (hip[:, 2] > ankle[:, 2] + 0.8).all()
    # Left is left: seen along the toes, the left hip is on the left-hand side.
    toe = recording.keypoints[0, keypoint_index("left_toe")] - ankle[0]
    across = hip[0] - recording.keypoints[0, keypoint_index("right_hip")]
    assert np.cross(toe, across)[2] > 0


def test_replayed_feet_rest_flat_on_the_floor(tmp_path: Path, stick: BodyModel) -> None:
    (tmp_path / "walk.bvh").write_text(walking_bvh())
    (recording,) = read_recordings(tmp_path)
    person = draw_physique(np.random.default_rng(0), stick, 1.7)
    performance = replay(Replay(recording, 0.0, (0.5, 4.0), 1.0), person, np.arange(80) / 30)
    soles = soles_of(performance, person, stick)
    still = np.linalg.norm(np.diff(soles, axis=0), axis=-1).max(axis=-1) < 1e-3
    assert still.mean() > 0.2
    assert np.abs(soles[1:, ..., 2].min(axis=-1)[still]).max() < 5e-3
    assert soles[..., 2].min() > -5e-3
    np.testing.assert_allclose(performance.pelvis[0, :2], [0.5, 4.0], atol=0.1)


@pytest.mark.shared
def test_real_motion_capture_can_be_replayed(shared_data: Path, stick: BodyModel) -> None:
    recordings = read_recordings(shared_data / "mocap")
    assert len(recordings) >= 9
    person = draw_physique(np.random.default_rng(0), stick, 1.7)
    for recording in recordings:
        performance = replay(Replay(recording, 0.0, (0.0, 5.0), 0.0), person, np.arange(30) / 30)
        soles = soles_of(performance, person, stick)
        assert np.isfinite(performance.rotations).all()
        assert soles[..., 2].min() > -0.02
        assert 0.6 < np.median(performance.pelvis[:, 2]) < 1.3 or "jump" in recording.name
