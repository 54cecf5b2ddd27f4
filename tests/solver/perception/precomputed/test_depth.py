"""Depth and disparity written in each form and read back."""

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from core_solver.errors import UserError
from core_solver.perception.precomputed.depth import read_depth, read_plane, with_range
from core_solver.perception.precomputed.exr import decode_exr
from core_solver.perception.precomputed.pfm import decode_pfm
from tests.solver.perception.precomputed.damage import damaged, value_or_user_error

RAMP = (np.arange(24 * 40, dtype=np.float32).reshape(24, 40) + 1) / 100


def pfm(values: np.ndarray, order: str = "<") -> bytes:
    height, width = values.shape
    head = f"Pf\n{width} {height}\n{-1.0 if order == '<' else 1.0}\n".encode()
    return head + values[::-1].astype(f"{order}f4").tobytes()


def exr(channels: dict[str, np.ndarray], *, zipped: int = 0, top: int = 0) -> bytes:
    """An EXR file from its published description: compression 0 (none), 2 (a row a chunk) or 3 (16 rows)."""
    height, width = next(iter(channels.values())).shape
    kinds = {np.dtype("u4"): 0, np.dtype("f2"): 1, np.dtype("f4"): 2}
    listed = b"".join(
        name.encode() + b"\0" + struct.pack("<iIii", kinds[values.dtype], 0, 1, 1)
        for name, values in sorted(channels.items())
    )
    window = struct.pack("<4i", 0, top, width - 1, top + height - 1)

    def attribute(name: str, kind: str, value: bytes) -> bytes:
        return f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value

    head = struct.pack("<II", 20000630, 2)
    head += attribute("channels", "chlist", listed + b"\0") + attribute("compression", "compression", bytes([zipped]))
    head += attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window)
    head += attribute("lineOrder", "lineOrder", b"\0") + b"\0"
    chunks = []
    rows = {0: 1, 2: 1, 3: 16}[zipped]
    for first in range(0, height, rows):
        lines = range(first, min(first + rows, height))
        raw = b"".join(channels[name][y].tobytes() for y in lines for name in sorted(channels))
        body = raw
        if zipped:
            split = np.frombuffer(raw[0::2] + raw[1::2], np.uint8).astype(int)
            steps = np.concatenate([split[:1], (np.diff(split) + 128) % 256]).astype(np.uint8)
            small = zlib.compress(steps.tobytes())
            body = small if len(small) < len(raw) else raw
        chunks.append(struct.pack("<ii", top + first, len(body)) + body)
    place = len(head) + 8 * len(chunks)
    table = b""
    for chunk in chunks:
        table += struct.pack("<Q", place)
        place += len(chunk)
    return head + table + b"".join(chunks)


@pytest.mark.parametrize("order", ["<", ">"])
def test_pfm_rows_run_upwards(order: str) -> None:
    assert np.array_equal(decode_pfm(pfm(RAMP, order)), RAMP)


def test_opencvs_pfm_is_read_alike(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "1.pfm"), RAMP)
    assert np.array_equal(read_plane(tmp_path / "1.pfm"), RAMP)


@pytest.mark.parametrize("zipped", [0, 2, 3])
@pytest.mark.parametrize("kind", ["f2", "f4", "u4"])
def test_exr(zipped: int, kind: str) -> None:
    values = np.round(100 * RAMP).astype(kind)
    found = decode_exr(exr({"Z": values, "A": np.zeros_like(RAMP)}, zipped=zipped, top=-3))
    assert np.array_equal(found, values.astype(np.float32))


def test_exr_prefers_depth_to_colour() -> None:
    assert np.array_equal(decode_exr(exr({"R": RAMP, "G": RAMP, "Y": 2 * RAMP})), 2 * RAMP)
    assert np.array_equal(decode_exr(exr({"my.distance": RAMP})), RAMP)
    with pytest.raises(ValueError, match="name it Z"):
        decode_exr(exr({"N.x": RAMP, "N.y": RAMP}))


@pytest.mark.parametrize("half", [False, True])
def test_opencvs_exr_is_read_alike(tmp_path: Path, half: bool) -> None:
    """Written in another process: OpenCV asks once, when it first meets such a file, whether it may."""
    np.save(tmp_path / "ramp.npy", RAMP)
    flags = "[cv2.IMWRITE_EXR_TYPE, cv2.IMWRITE_EXR_TYPE_HALF]" if half else "[]"
    script = f"import cv2, numpy as np; assert cv2.imwrite('1.exr', np.load('ramp.npy'), {flags})"
    environment = {**os.environ, "OPENCV_IO_ENABLE_OPENEXR": "1"}
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, env=environment, check=False)
    if done.returncode:
        pytest.skip("this OpenCV writes no EXR files")
    np.testing.assert_allclose(read_plane(tmp_path / "1.exr"), RAMP, rtol=1e-3 if half else 0)


def test_disparity_of_sixteen_bits_is_stretched_and_near_stays_large(tmp_path: Path) -> None:
    levels = np.linspace(1000, 60000, 40)[None].repeat(24, axis=0).astype(np.uint16)
    assert cv2.imwrite(str(tmp_path / "frame_7.png"), levels)
    depth = read_depth(tmp_path, is_metric=False)
    assert depth.planes.numbers == {7}
    plane = depth.read(7)
    assert plane.dtype == np.float16
    np.testing.assert_allclose(plane.astype(float), np.linspace(0, 1, 40)[None].repeat(24, axis=0), atol=0.01)


def test_metric_depth_becomes_disparity_on_one_scale_for_the_clip(tmp_path: Path) -> None:
    near, far = np.full((24, 40), 2.0), np.full((24, 40), 8.0)
    far[:, 20:], far[0, 0], far[0, 1], far[0, 2] = 4.0, 0, np.inf, np.nan
    np.savez(tmp_path / "0.npz", depth=near)
    np.savez(tmp_path / "1.npz", depth=far)
    depth = with_range(read_depth(tmp_path, is_metric=False), [0, 1])
    assert depth.is_metric, "the array's own name says so"
    first, second = depth.read(0), depth.read(1)
    np.testing.assert_allclose(first.astype(float), 1, atol=2e-3)
    assert np.isnan(second[0, :3]).all()
    # From 8 m to 4 m the inverse depth goes a third of the way to 2 m.
    np.testing.assert_allclose(second[5, 5], 0, atol=2e-3)
    np.testing.assert_allclose(second[5, 35], 1 / 3, atol=2e-3)


def test_millimetres_in_pictures_make_no_difference(tmp_path: Path) -> None:
    metres = 2 + 3 * RAMP
    for folder, unit in (("mm", 1000), ("cm", 100)):
        (tmp_path / folder).mkdir()
        assert cv2.imwrite(str(tmp_path / folder / "1.png"), np.round(unit * metres).astype(np.uint16))
    planes = [with_range(read_depth(tmp_path / f, is_metric=True), [1]).read(1).astype(float) for f in ("mm", "cm")]
    np.testing.assert_allclose(*planes, atol=0.01)
    assert planes[0].max() > 0.99
    assert planes[0].min() < 0.01
    assert planes[0][0, 0] > planes[0][-1, -1]


def test_all_frames_in_one_archive(tmp_path: Path) -> None:
    stack = np.stack([RAMP, RAMP[::-1], RAMP])
    np.savez(tmp_path / "all.npz", disparity=stack, frames=[5, 9, 2])
    depth = read_depth(tmp_path / "all.npz", is_metric=True)
    assert not depth.is_metric
    assert depth.planes.numbers == {5, 9, 2}
    assert np.array_equal(depth.planes.read(9), RAMP[::-1])
    np.savez(tmp_path / "all.npz", disparity=stack)
    assert read_depth(tmp_path, is_metric=True).planes.numbers == {0, 1, 2}
    np.savez(tmp_path / "all.npz", disparity=stack, frames=[5, 5, 2])
    with pytest.raises(UserError, match="one whole number for each of the 3"):
        read_depth(tmp_path, is_metric=True)
    np.savez(tmp_path / "all.npz", disparity=stack[:0])
    with pytest.raises(UserError, match="no pictures"):
        read_depth(tmp_path, is_metric=True)


def test_large_planes_are_kept_small(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "1.png"), cv2.resize(RAMP, (1920, 1080)).astype(np.uint8))
    assert read_depth(tmp_path, is_metric=False).read(1).shape == (288, 512)


def test_what_is_no_depth_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="holds no depth"):
        read_depth(tmp_path, is_metric=True)
    cv2.imwrite(str(tmp_path / "1.png"), np.random.default_rng(0).integers(0, 255, (24, 40, 3), np.uint8))
    with pytest.raises(UserError, match=r"1\.png is coloured"):
        read_depth(tmp_path, is_metric=True).read(1)
    (tmp_path / "1.pfm").write_bytes(pfm(RAMP))
    with pytest.raises(UserError, match=r"\.pfm and \.png"):
        read_depth(tmp_path, is_metric=True)
    (tmp_path / "1.png").unlink()
    (tmp_path / "1.pfm").write_bytes(pfm(0 * RAMP))
    with pytest.raises(UserError, match="no depth above 0"):
        with_range(read_depth(tmp_path, is_metric=True), [1])


def archive(tmp_path: Path) -> bytes:
    np.savez(tmp_path / "whole.npz", disparity=RAMP)
    return (tmp_path / "whole.npz").read_bytes()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    npz = archive(tmp_path_factory.mktemp("whole"))
    return {".npz": npz, ".pfm": pfm(RAMP), ".exr": exr({"Z": RAMP}), ".zip.exr": exr({"Z": RAMP}, zipped=3),
            ".png": cv2.imencode(".png", (1000 * RAMP).astype(np.uint16))[1].tobytes()}  # fmt: skip


@pytest.mark.parametrize("suffix", [".npz", ".pfm", ".exr", ".zip.exr", ".png"])
def test_damaged_files_give_a_line_or_a_plane(tmp_path: Path, whole: dict[str, bytes], suffix: str) -> None:
    @given(damaged(whole[suffix]))
    @settings(deadline=None, max_examples=120, suppress_health_check=list(HealthCheck), database=None)
    def check(content: bytes) -> None:
        plane = value_or_user_error(tmp_path / f"1{suffix}", content, read_plane)
        if plane is not None:
            assert plane.ndim == 2
            assert plane.dtype == np.float32
            assert not np.isinf(plane).any()

    check()
