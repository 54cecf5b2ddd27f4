import numpy as np
import pytest
import torch

from core_solver.optimise.presets import PRESETS
from core_solver.optimise.solve import Solution, solve
from core_solver.progress import SilentProgress
from tests.solver.body.synthetic import make_stick_body
from tests.solver.scenes import SyntheticClip, Walker, change_tracks, make_clip

GAP = slice(12, 22)
LATE = 6


@pytest.fixture(scope="session", autouse=True)
def one_thread():
    """Sums in one order: results repeat bit by bit, and a shared machine is not fought over."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def body():
    return make_stick_body()


@pytest.fixture(scope="session")
def couple(body) -> SyntheticClip:
    """An adult and a smaller person who walk on one floor; the second enters late and both are hidden for a while."""
    walkers = [Walker(1.0, (-1, 5), 0.5), Walker(0.85, (1, 6), -1.0)]
    clip = make_clip(body, walkers, frames=36, camera_height=2.2)
    absent = {1: np.arange(36)[GAP], 2: np.arange(LATE)}
    modalities = change_tracks(clip, lambda track: hide(track, absent[track.id]))
    return SyntheticClip(**{**vars(clip), "modalities": modalities})


def hide(track, frames):
    """The track without evidence in some frames: interpolated as tracking does, the first sight held before it."""
    from dataclasses import replace

    valid = track.valid.copy()
    valid[frames] = False
    known = np.flatnonzero(valid)

    def fill(values):
        flat = values.reshape(len(values), -1)
        filled = [np.interp(np.arange(len(values)), known, flat[known, i]) for i in range(flat.shape[1])]
        return np.stack(filled, axis=1).reshape(values.shape).astype(values.dtype)

    return replace(
        track, valid=valid, keypoints=fill(track.keypoints), landmarks=fill(track.landmarks),
        confidence=np.where(valid[:, None], track.confidence, 0).astype(np.float32),
    )  # fmt: skip


@pytest.fixture(scope="session")
def couple_solved(couple, body) -> Solution:
    return solve(couple.modalities, couple.camera, body, SilentProgress(), PRESETS["fast"])
