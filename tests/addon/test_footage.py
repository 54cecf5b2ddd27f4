"""The video behind the camera: the right frame at every scene frame, straightened by the take's lens."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.take import CameraModel, write_take

from .blender_truth import composite
from .take_factory import TakeSpec, make_take

WIDTH, HEIGHT = 320, 200


def write_video(path: Path, frames: list[np.ndarray]) -> None:
    """Uncompressed grey video; frames are (H, W) in [0, 1]."""
    height, width = frames[0].shape
    no_colour = np.full(height * width // 2, 128, np.uint8).tobytes()
    with path.open("wb") as stream:
        stream.write(f"YUV4MPEG2 W{width} H{height} F30:1 Ip A1:1 C420\n".encode())
        for frame in frames:
            stream.write(b"FRAME\n" + (16 + 219 * frame).astype(np.uint8).tobytes() + no_colour)


def import_with_video(bpy: Any, folder: Path, spec: TakeSpec, video: list[np.ndarray], **options: str) -> Any:
    """Import a take that lies beside its video; gives the clip behind the camera."""
    take = make_take(spec)
    write_take(folder / "match.npz", take)
    write_video(folder / take.meta.video_name, video)
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(folder / "match.npz"), **options)
    (background,) = bpy.context.scene.camera.data.background_images
    assert background.source == "MOVIE_CLIP"
    return background.clip


@pytest.mark.parametrize(("first_frame", "step"), [(0, 1), (4, 1), (0, 2), (3, 3)])
def test_every_scene_frame_shows_its_video_frame(first_frame: int, step: int, bpy: Any, tmp_path: Path) -> None:
    spec = TakeSpec(people=0, frames=5, width=32, height=32, points=8, first_frame=first_frame, frame_step=step)
    video = [np.full((32, 32), index / 20) for index in range(20)]
    clip = import_with_video(bpy, tmp_path, spec, video)
    for index in range(spec.frames):
        shown = composite(bpy, clip, 1 + index, tmp_path / "frame.png")
        assert round(20 * float(shown.mean())) == first_frame + step * index


def test_footage_is_straightened_by_the_takes_distortion(bpy: Any, tmp_path: Path) -> None:
    spec = TakeSpec(
        people=0, frames=2, width=WIDTH, height=HEIGHT, fx=250.0, fy=250.0, cx=175.0, cy=85.0, points=8,
        distortion=(-0.25, 0.08, 0.03, -0.015, 0.01),
    )  # fmt: skip
    camera = make_take(spec).meta.camera
    straight = np.array([[u, v] for u in (80, 120, 160, 200, 240) for v in (60, 100, 140)], float)
    bent = distort(camera, straight)
    assert np.abs(bent - straight).max() > 2
    clip = import_with_video(bpy, tmp_path, spec, [dots(bent)] * 2)
    assert bpy.context.scene.camera.data.background_images[0].clip_user.use_render_undistorted
    error = centres(composite(bpy, clip, 1, tmp_path / "frame.png", undistort=True), straight) - straight
    # Since 4.5 the compositor moves the straightened image as a whole, which the camera's background does not.
    assert np.abs(error - error.mean(axis=0)).max() < 0.3


def test_no_distortion_is_shown_as_it_is(bpy: Any, tmp_path: Path) -> None:
    spec = TakeSpec(people=0, frames=2, width=32, height=32, points=8)
    import_with_video(bpy, tmp_path, spec, [np.zeros((32, 32))] * 2)
    assert not bpy.context.scene.camera.data.background_images[0].clip_user.use_render_undistorted


def test_a_smaller_copy_of_the_video_gets_a_smaller_lens(bpy: Any, tmp_path: Path) -> None:
    spec = TakeSpec(people=0, frames=2, width=64, height=32, fx=50.0, fy=40.0, cx=30.0, cy=20.0, points=8)
    clip = import_with_video(bpy, tmp_path, spec, [np.zeros((16, 32))] * 2)
    lens = clip.tracking.camera
    assert lens.focal_length_pixels == pytest.approx(25)
    assert lens.principal_point_pixels[:] == pytest.approx((15, 6))
    assert lens.pixel_aspect == pytest.approx(0.8)


def test_a_video_chosen_elsewhere_is_used(bpy: Any, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    write_video(elsewhere / "clip.y4m", [np.zeros((32, 32))] * 2)
    write_take(tmp_path / "match.npz", make_take(TakeSpec(people=0, frames=2, width=32, height=32, points=8)))
    for choice in (elsewhere, elsewhere / "clip.y4m"):
        bpy.ops.wm.read_homefile(use_empty=True)
        bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "match.npz"), footage=str(choice))
        (background,) = bpy.context.scene.camera.data.background_images
        assert Path(background.clip.filepath) == elsewhere / "clip.y4m"


@pytest.mark.parametrize("kind", ["missing", "another shape", "not a video"])
def test_footage_that_cannot_be_shown_is_said_and_does_not_stop_the_import(
    kind: str, bpy: Any, addon: Any, tmp_path: Path
) -> None:
    take = make_take(TakeSpec(people=1, frames=2, points=8))
    if kind == "another shape":
        write_video(tmp_path / take.meta.video_name, [np.zeros((64, 32))] * 2)
    if kind == "not a video":
        (tmp_path / take.meta.video_name).write_text("text")
    take_import = addon("scene_import.take_import")
    imported = take_import.import_take(bpy.context, take, tmp_path / "match.npz", take_import.ImportOptions())
    assert [note for note in imported.notes if "clip.y4m" in note]
    assert len(imported.armatures) == 1
    assert not imported.camera.data.background_images
    assert not bpy.data.movieclips


def distort(camera: CameraModel, pixels: np.ndarray) -> np.ndarray:
    """OpenCV's lens model, from straight to filmed pixels."""
    k1, k2, p1, p2, k3 = camera.distortion
    x, y = (pixels[:, 0] - camera.cx) / camera.fx, (pixels[:, 1] - camera.cy) / camera.fy
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    bent_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([camera.fx * bent_x + camera.cx, camera.fy * bent_y + camera.cy], axis=-1)


def dots(pixels: np.ndarray) -> np.ndarray:
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    squares = (u - pixels[:, 0, None, None]) ** 2 + (v - pixels[:, 1, None, None]) ** 2
    return np.exp(-squares / (2 * 2.5**2)).max(axis=0)


def centres(image: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Centre of brightness around each of the given pixels."""
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    window = (np.abs(u - near[:, 0, None, None]) < 19) & (np.abs(v - near[:, 1, None, None]) < 19)
    weight = window * image
    total = weight.sum(axis=(1, 2))
    return np.stack([(weight * u).sum(axis=(1, 2)) / total, (weight * v).sum(axis=(1, 2)) / total], axis=-1)
