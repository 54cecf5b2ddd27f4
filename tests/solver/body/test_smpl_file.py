"""Users' SMPL files: npz and pickle, with chumpy's wrapper but without chumpy, and never running what a file says."""

import io
import os
import pickle
import sys
import types

import numpy as np
import pytest
from scipy import sparse

from core_solver.body import PARENTS, load_body, load_smpl
from core_solver.errors import ModelError
from tests.solver.body import checks
from tests.solver.body.synthetic import make_stick_body

BODY = make_stick_body()
POSE_DIRECTIONS = np.random.default_rng(0).normal(0, 1e-3, (len(BODY.template), 3, 207))


def smpl_entries() -> dict:
    """What an SMPL file holds, for the body of boxes; 300 shape directions as the newest files have."""
    more = np.concatenate([BODY.shape_directions, np.zeros((len(BODY.template), 3, 290))], axis=2)
    return {
        "v_template": BODY.template,
        "shapedirs": more,
        "posedirs": POSE_DIRECTIONS,
        "J_regressor": BODY.joint_regressor,
        "weights": BODY.weights,
        "f": BODY.faces.astype(np.uint32),
        "kintree_table": np.array([[2**32 - 1, *PARENTS[1:]], range(24)]),
    }


@pytest.fixture
def chumpy(monkeypatch):
    """A stand-in for the chumpy package, there only while a test writes its pickle."""
    package, arrays, reordering = (types.ModuleType(n) for n in ("chumpy", "chumpy.ch", "chumpy.reordering"))

    class Ch:
        def __init__(self, **state):
            self.__dict__.update(state, _dirty_vars=set(), _itr=None, _depends_on_deps={})

    class Select(Ch):
        pass

    Ch.__module__, Select.__module__ = "chumpy.ch", "chumpy.reordering"
    Ch.__qualname__, Select.__qualname__ = "Ch", "Select"
    vars(arrays)["Ch"], vars(reordering)["Select"] = Ch, Select
    for module in (package, arrays, reordering):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return types.SimpleNamespace(Ch=Ch, Select=Select, forget=monkeypatch.undo)


def assert_is_the_stick_body(model) -> None:
    np.testing.assert_allclose(model.template, BODY.template)
    np.testing.assert_allclose(model.shape_directions, BODY.shape_directions)
    np.testing.assert_allclose(model.pose_directions, POSE_DIRECTIONS)
    np.testing.assert_allclose(model.joint_template, BODY.joint_template, atol=1e-12)
    np.testing.assert_array_equal(model.faces, BODY.faces)
    checks.assert_consistent(model)
    assert model.id.startswith("smpl-")
    assert len(model.id) == len("smpl-") + 8


def test_npz(tmp_path):
    np.savez(tmp_path / "model.npz", **smpl_entries())
    model = load_body(tmp_path / "model.npz")
    assert_is_the_stick_body(model)
    assert model.id == load_smpl(tmp_path / "model.npz").id


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_pickle_with_chumpy_and_sparse_arrays(tmp_path, chumpy, protocol):
    entries = smpl_entries()
    entries["v_template"] = chumpy.Ch(x=entries["v_template"])
    shape = entries["shapedirs"].shape
    every = np.arange(entries["shapedirs"].size)
    inner = chumpy.Ch(x=entries["shapedirs"].ravel())
    entries["shapedirs"] = chumpy.Select(a=inner, idxs=every, preferred_shape=shape)
    entries["J_regressor"] = sparse.csc_matrix(entries["J_regressor"])
    entries["bs_style"] = "lbs"
    (tmp_path / "model.pkl").write_bytes(pickle.dumps(entries, protocol))
    chumpy.forget()
    assert "chumpy" not in sys.modules
    assert_is_the_stick_body(load_body(tmp_path / "model.pkl"))


def test_pickle_with_compressed_rows(tmp_path):
    entries = smpl_entries() | {"J_regressor": sparse.csr_matrix(BODY.joint_regressor)}
    (tmp_path / "model.pkl").write_bytes(pickle.dumps(entries))
    assert_is_the_stick_body(load_smpl(tmp_path / "model.pkl"))


class Runs:
    """A pickle that calls any function when it is opened."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


@pytest.mark.parametrize("where", ["alone", "inside"])
def test_a_pickle_that_runs_a_command_is_refused(tmp_path, where):
    mark = tmp_path / "was_run"
    attack = Runs(os.system, f"touch '{mark}'")
    content = attack if where == "alone" else smpl_entries() | {"bs_type": attack}
    (tmp_path / "model.pkl").write_bytes(pickle.dumps(content))
    with pytest.raises(ModelError, match="system"):
        load_body(tmp_path / "model.pkl")
    assert not mark.exists()


@pytest.mark.parametrize(
    "attack",
    [
        Runs(eval, "1 + 1"),
        Runs(getattr, "text", "format"),
        Runs(np.fromfile, "/etc/hostname"),
        Runs(np.load, "/etc/hostname"),
        Runs(io.open, "/etc/hostname"),
        Runs(sparse.load_npz, "/etc/hostname"),
    ],
)
def test_no_other_function_is_called_either(tmp_path, attack):
    (tmp_path / "model.pkl").write_bytes(pickle.dumps(smpl_entries() | {"bs_type": attack}))
    with pytest.raises(ModelError, match="not opened"):
        load_smpl(tmp_path / "model.pkl")


@pytest.mark.parametrize("name", ["v_template", "shapedirs", "posedirs", "J_regressor", "weights", "f"])
def test_a_missing_array_is_named(tmp_path, name):
    entries = smpl_entries()
    del entries[name]
    path = tmp_path / "model.npz"
    np.savez(path, **entries)
    with pytest.raises(ModelError, match=f"lacks '{name}'"):
        load_body(path)


def test_other_models_and_damage_are_refused(tmp_path):
    path = tmp_path / "model.npz"
    np.savez(path, **smpl_entries() | {"weights": np.zeros((len(BODY.template), 52))})
    with pytest.raises(ModelError, match="24-joint"):
        load_body(path)
    np.savez(path, **smpl_entries() | {"v_template": np.full_like(BODY.template, np.nan)})
    with pytest.raises(ModelError, match="finite"):
        load_body(path)
    np.savez(path, **smpl_entries() | {"f": BODY.faces + 1})
    with pytest.raises(ModelError, match="faces"):
        load_body(path)
    tree = smpl_entries()["kintree_table"]
    tree[0, 5] = 0
    np.savez(path, **smpl_entries() | {"kintree_table": tree})
    with pytest.raises(ModelError, match="joints"):
        load_body(path)
    (tmp_path / "cut.pkl").write_bytes(pickle.dumps(smpl_entries())[:999])
    with pytest.raises(ModelError, match="cannot be read"):
        load_body(tmp_path / "cut.pkl")
    for name in ("text.pkl", "text.npz", "text.mp4"):
        (tmp_path / name).write_text("not a model")
        with pytest.raises(ModelError, match="give an SMPL file"):
            load_body(tmp_path / name)
