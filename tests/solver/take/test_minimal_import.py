"""Blender reads takes with nothing but numpy: so must we."""

import subprocess
import sys
from pathlib import Path

from core_solver.take import write_take
from tests.solver.take.random_takes import random_take

READ_WITH_NUMPY_ALONE = """
import sys

class Blocker:
    allowed = {"numpy", "core_solver"} | sys.stdlib_module_names

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in self.allowed:
            raise ImportError(f"{name} is not part of a plain numpy installation")

sys.meta_path.insert(0, Blocker())
try:
    import scipy
except ImportError:
    pass
else:
    raise SystemExit("the blocker does not block")

from core_solver.geometry import GroundFrame, fit_similarity, matrix_from_rotvec, world_from_camera
from core_solver.take import read_take, write_take
import numpy as np

take = read_take(sys.argv[1])
write_take(sys.argv[2], take)
meta = take.meta
world_from_camera(GroundFrame(np.array(meta.gravity), np.array(meta.ground.normal), meta.ground.offset))
matrix_from_rotvec(take.people[0].theta)
print(sorted(m for m in sys.modules if m.startswith("core_solver")))
"""


def test_take_and_geometry_need_only_numpy(tmp_path: Path, repo_root: Path) -> None:
    first, second = tmp_path / "first.npz", tmp_path / "second.npz"
    write_take(first, random_take())
    command = [sys.executable, "-S", "-c", READ_WITH_NUMPY_ALONE, str(first), str(second)]
    # Without `site`, no package's start-up file loads anything first; the search path is then ours to give.
    search = [str(repo_root), *(p for p in sys.path if p)]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={"PYTHONPATH": ":".join(search)}, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert "core_solver.geometry.torch_ops" not in done.stdout
    assert second.read_bytes() == first.read_bytes()
