"""Truth with wrong bytes anywhere is read or refused; nothing else may happen."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from core_solver.evaluation.multiview import read_multiview
from core_solver.evaluation.mupots_layout import read_mupots
from core_solver.evaluation.panoptic import read_panoptic
from core_solver.evaluation.real_truth import TruthError
from tests.solver.evaluation import test_multiview, test_mupots_layout, test_panoptic
from tests.solver.evaluation.real_takes import limbs_of, standing_take

TAKE = standing_take(1, 2)


def mupots(directory: Path) -> Path:
    test_mupots_layout.write_sequence(directory / "TS1", test_mupots_layout.skeletons_of(TAKE))
    return directory / "TS1" / "annot.mat"


def multiview(directory: Path) -> Path:
    return test_multiview.write_truth(directory / "truth.npz", limbs_of(TAKE))


def calibration(directory: Path) -> Path:
    test_panoptic.write_sequence(directory / "a", limbs_of(TAKE))
    return directory / "a" / "calibration_a.json"


def scene(directory: Path) -> Path:
    return calibration(directory).parent / "hdPose3d_stage1_coco19" / "body3DScene_00000001.json"


READERS = {
    mupots: lambda path: read_mupots(path.parent),
    multiview: read_multiview,
    calibration: lambda path: read_panoptic(path.parent),
    scene: lambda path: read_panoptic(path.parents[1]),
}


@pytest.fixture(params=READERS, ids=lambda write: write.__name__)
def kind(request, tmp_path):
    """Path, right bytes, and reader."""
    path = request.param(tmp_path)
    return path, path.read_bytes(), READERS[request.param]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(edits=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), max_size=4), kept=st.floats(0.2, 3))
def test_wrong_bytes_and_cut_files_are_read_or_refused(kind, edits, kept):
    path, right, read = kind
    wrong = bytearray(right[: int(kept * len(right))])
    for place, value in edits:
        wrong[int(place * (len(wrong) - 1))] = value
    path.write_bytes(bytes(wrong))
    with np.errstate(all="ignore"):
        try:
            read(path)
        except TruthError as refusal:
            assert path.name in str(refusal)  # noqa: PT017 - reading may also succeed


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["bodies", "id", "K", "R"]), inner),
    max_leaves=8,
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(value=JSON, key=st.sampled_from(["K", "R", "t", "distCoef", "resolution", "name"]))
def test_a_calibration_of_wrong_values_is_read_or_refused(tmp_path_factory, value, key):
    path = calibration(tmp_path_factory.mktemp("c"))
    document = json.loads(path.read_text())
    document["cameras"][0][key] = value
    path.write_text(json.dumps(document))
    try:
        read_panoptic(path.parent)
    except TruthError as refusal:
        assert path.name in str(refusal)  # noqa: PT017 - reading may also succeed
