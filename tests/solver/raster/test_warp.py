"""The GPU's kernels: run on Warp's own CPU device, and compiled for a GPU that need not be there."""

import sys
from pathlib import Path

import numpy as np
import pytest

from core_solver.errors import UserError
from core_solver.raster import RasterTerms, fused, solve_terms

from .scenes import FIGURE, SMALL, picture_of, standing


def check_equal(a: RasterTerms, b: RasterTerms) -> None:
    for name in a.__dataclass_fields__:
        ours, theirs = getattr(a, name), getattr(b, name)
        assert theirs.dtype == ours.dtype
        np.testing.assert_allclose(theirs, ours, rtol=1e-4, atol=2e-5, err_msg=name)


def test_without_warp_the_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "warp", None)
    monkeypatch.delitem(sys.modules, "core_solver.raster.warp_backend", raising=False)
    monkeypatch.delitem(sys.modules, "core_solver.raster.warp_kernels", raising=False)
    with pytest.raises(UserError, match=r"scene-aware-mocap\[cuda\]"):
        import core_solver.raster.warp_backend  # noqa: F401


def test_warp_agrees_with_numba() -> None:
    pytest.importorskip("warp")
    from core_solver.raster.warp_backend import fused_by_warp, solve_terms_by_warp

    mask = picture_of(standing(across=0.1), SMALL)[None]
    visible = np.random.default_rng(0).random(mask.shape) > 0.1
    body = standing()[None]
    check_equal(
        fused(body, FIGURE.faces, SMALL, mask, visible), fused_by_warp(body, FIGURE.faces, SMALL, mask, visible, "cpu")
    )
    clip = np.stack([np.stack([standing(3, 0.1), standing(depth, -0.1), standing() * np.nan]) for depth in (2.5, 3.5)])
    labels = np.random.default_rng(0).choice(np.array([0, 0, 3, 5, 9, 255], np.uint8), (2, SMALL.height, SMALL.width))
    check_equal(
        solve_terms(clip, FIGURE.faces, SMALL, labels, [3, 5, 9]),
        solve_terms_by_warp(clip, FIGURE.faces, SMALL, labels, [3, 5, 9], "cpu"),
    )


def test_the_kernels_compile_for_a_gpu(tmp_path: Path) -> None:
    wp = pytest.importorskip("warp")
    from core_solver.raster import warp_kernels

    wp.compile_aot_module(warp_kernels, arch=80, module_dir=tmp_path)
    source = next(tmp_path.glob("*.cu")).read_text(encoding="utf-8")
    for kernel in ("project", "draw", "cost_by_labels", "shade", "to_camera_frame"):
        assert f"{kernel}_" in source
    assert "__global__" in source
    assert any(path.suffix in {".cubin", ".ptx"} for path in tmp_path.iterdir())
