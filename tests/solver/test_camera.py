"""Projection against OpenCV's and by hand; camera files of every kind, and what is refused of them."""

import dataclasses
import json
import math
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.camera import Camera, camera_from_fov, camera_from_model, read_camera
from core_solver.errors import CameraError
from core_solver.take import CameraModel, write_take
from tests.solver.take.random_takes import random_take

WIDTH, HEIGHT = 1280, 720
PINHOLE = Camera(WIDTH, HEIGHT, 900.0, 880.0, 650.0, 350.0)


@st.composite
def lenses(draw: st.DrawFn) -> Camera:
    """Lenses as calibrations find them: up to about 15 % of bend at the corners, one-to-one over the picture."""
    small = st.floats(-0.003, 0.003)
    distortion = (draw(st.floats(-0.2, 0.2)), draw(st.floats(-0.05, 0.05)), draw(small), draw(small), draw(small))
    fx = draw(st.floats(900, 2000))
    return Camera(
        WIDTH, HEIGHT, fx, fx * draw(st.floats(0.9, 1.1)), draw(st.floats(600, 680)), draw(st.floats(330, 390)),
        distortion,
    )  # fmt: skip


@st.composite
def seen_points(draw: st.DrawFn) -> np.ndarray:
    """Points 0.5 to 50 m before the camera, inside a field of view of about 65 degrees."""
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    depth = rng.uniform(0.5, 50, (20, 1))
    return np.concatenate(
        [rng.uniform(-0.64, 0.64, (20, 1)) * depth, rng.uniform(-0.36, 0.36, (20, 1)) * depth, depth], 1
    )


# --- geometry ---


@pytest.mark.parametrize("k1", [-0.35, -0.2, 0.1])
def test_what_lies_far_outside_the_picture_is_not_folded_into_it(k1: float) -> None:
    camera = dataclasses.replace(PINHOLE, distortion=(k1, 0.02, 0.0, 0.0, 0.0))
    slopes = np.linspace(0.01, 8, 400)
    pixels = camera.project(np.stack([slopes, 0.3 * slopes, np.ones_like(slopes)], axis=-1))
    assert np.all(np.diff(pixels[:, 0]) > 0)
    assert pixels[-1, 0] > 2 * WIDTH


@given(lenses(), seen_points())
def test_projection_is_the_brown_model(camera: Camera, points: np.ndarray) -> None:
    k1, k2, p1, p2, k3 = camera.distortion
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = camera.fx * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + camera.cx
    v = camera.fy * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + camera.cy
    np.testing.assert_allclose(camera.project(points), np.stack([u, v], -1), atol=1e-8)


@given(lenses(), seen_points())
def test_projection_agrees_with_opencv(camera: Camera, points: np.ndarray) -> None:
    K, nothing = camera.matrix, np.zeros(3)
    bent, _ = cv2.projectPoints(points, nothing, nothing, K, np.array(camera.distortion))
    straight, _ = cv2.projectPoints(points, nothing, nothing, K, np.zeros(5))
    np.testing.assert_allclose(camera.project(points), bent[:, 0], atol=1e-9)
    np.testing.assert_allclose(camera.project(points, distorted=False), straight[:, 0], atol=1e-9)


@given(lenses(), seen_points())
def test_undistort_takes_the_lens_away(camera: Camera, points: np.ndarray) -> None:
    ideal = camera.project(points, distorted=False)
    np.testing.assert_allclose(camera.undistort(camera.project(points)), ideal, atol=1e-4)


@given(lenses(), seen_points())
def test_rays_pass_through_the_points_that_project_there(camera: Camera, points: np.ndarray) -> None:
    rays = camera.rays(camera.project(points))
    np.testing.assert_array_equal(rays[:, 2], 1)
    np.testing.assert_allclose(rays * points[:, 2:], points, rtol=0, atol=1e-5)


def test_a_point_on_the_axis_is_the_principal_point() -> None:
    bent = dataclasses.replace(PINHOLE, distortion=(-0.2, 0.1, 0.01, 0.01, 0.0))
    for camera in (PINHOLE, bent):
        np.testing.assert_allclose(camera.project([0, 0, 3.0]), [650, 350], atol=1e-12)
    np.testing.assert_allclose(PINHOLE.project([1.0, 0.5, 2.0]), [650 + 450, 350 + 220], atol=1e-12)


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.1, 0.02, 0.0, 0.0, 0.0)])
@pytest.mark.parametrize("leading", [(), (0,), (4,), (2, 3), (0, 25)])
def test_any_leading_axes_pass_through(distortion: Any, leading: tuple[int, ...]) -> None:
    camera = dataclasses.replace(PINHOLE, distortion=distortion)
    pixels = camera.project(np.ones((*leading, 3)))
    assert pixels.shape == camera.undistort(pixels).shape == (*leading, 2)
    assert camera.rays(pixels).shape == (*leading, 3)


def test_undistort_hands_out_its_own_array() -> None:
    pixels = np.zeros((2, 2))
    PINHOLE.undistort(pixels)[:] = 5
    assert not pixels.any()


def test_grid_rays_pass_through_the_centres_of_cells() -> None:
    camera = camera_from_fov(80, 60, 60, "test")
    rays = camera.grid_rays(3, 4)
    assert rays.shape == (3, 4, 3)
    # Cells are 20x20 pixels: centres at 10, 30, 50, 70 across and 10, 30, 50 down.
    expected = np.stack(np.meshgrid([10, 30, 50, 70], [10, 30, 50]), -1)
    np.testing.assert_allclose(camera.project(rays), expected, atol=1e-9)
    # At the picture's own size the first cell is the top-left pixel, whose centre is (0.5, 0.5).
    np.testing.assert_allclose(camera.project(camera.grid_rays(60, 80))[0, 0], [0.5, 0.5], atol=1e-9)


@pytest.mark.parametrize(("width", "height"), [(1920, 1080), (1080, 1920), (600, 600)])
@given(fov=st.floats(5, 150))
def test_field_of_view_is_along_the_longer_side(width: int, height: int, fov: float) -> None:
    camera = camera_from_fov(width, height, fov, "a guess")
    assert camera.fx == camera.fy
    assert (camera.cx, camera.cy, camera.source) == (width / 2, height / 2, "a guess")
    assert camera.fov_degrees == pytest.approx(fov)
    edge = [0.5 * width if width >= height else 0, 0.5 * height if height > width else 0, camera.fx]
    assert math.degrees(math.atan2(math.hypot(*edge[:2]), edge[2])) == pytest.approx(fov / 2)


def test_ninety_degrees_see_as_far_aside_as_ahead() -> None:
    np.testing.assert_allclose(camera_from_fov(640, 480, 90, "").project([1.0, 0, 1.0]), [640, 240], atol=1e-9)


@pytest.mark.parametrize("fov", [0, 4.9, 151, -60, math.nan, math.inf])
def test_unbelievable_fields_of_view_are_refused(fov: float) -> None:
    with pytest.raises(CameraError, match="5 to 150"):
        camera_from_fov(640, 480, fov, "")


def test_the_takes_record_and_the_camera_are_one() -> None:
    camera = dataclasses.replace(PINHOLE, distortion=(0.1, 0, 0, 0, 0), source="test")
    model = camera.as_model()
    assert type(model) is CameraModel
    assert camera_from_model(model) == camera


# --- files ---

DISTORTION = (-0.11, 0.07, 0.001, -0.002, 0.003)


def numbers(camera: CameraModel) -> tuple[float, float, float, float]:
    return camera.fx, camera.fy, camera.cx, camera.cy


def write(path: Path, text: str) -> str:
    path.write_text(text, encoding="utf-8")
    return str(path)


def json_file(folder: Path, **changes: Any) -> str:
    record = {"width": WIDTH, "height": HEIGHT, "fx": 900.0, "fy": 880.0, "cx": 650.0, "cy": 350.0}
    return write(folder / "camera.json", json.dumps({**record, **changes}))


def test_our_json(tmp_path: Path) -> None:
    camera = read_camera(json_file(tmp_path, distortion=DISTORTION, source="Gerät"), WIDTH, HEIGHT)
    assert numbers(camera) == (900, 880, 650, 350)
    assert camera.distortion == DISTORTION
    assert camera.source == "file camera.json"


def test_json_without_size_or_distortion_is_for_this_video(tmp_path: Path) -> None:
    spec = write(tmp_path / "camera.json", json.dumps({"fx": 900, "fy": 880, "cx": 650, "cy": 350}))
    camera = read_camera(spec, WIDTH, HEIGHT)
    assert (camera.width, camera.height, camera.is_distorted) == (WIDTH, HEIGHT, False)


def test_the_meta_entry_of_a_take_is_a_camera_file(tmp_path: Path) -> None:
    write_take(tmp_path / "take.npz", random_take())
    with np.load(tmp_path / "take.npz") as archive:
        (tmp_path / "meta.json").write_bytes(archive["meta"].tobytes())
    camera = read_camera(str(tmp_path / "meta.json"), WIDTH, HEIGHT)
    truth = random_take().meta.camera
    assert (numbers(camera), camera.distortion) == (numbers(truth), truth.distortion)


@pytest.mark.parametrize(
    "text",
    [
        "900 0 650\n0 880 350\n0 0 1\n",
        "900,0,650\n0,880,350\n0,0,1",
        " 900.0, 0.0, 650.0\n 0, 8.8e2, 350\n\n 0, 0, 1\n",
        "\ufeff900 0 650\r\n0 880 350\r\n0 0 1\r\n",
        "# K of the left camera\n900\t0\t650\n0\t880\t350\n0\t0\t1\n",
    ],
)
def test_plain_text_matrices(tmp_path: Path, text: str) -> None:
    camera = read_camera(write(tmp_path / "K.txt", text), WIDTH, HEIGHT)
    assert numbers(camera) == (900, 880, 650, 350)
    assert not camera.is_distorted


def opencv_file(path: Path, names: tuple[str, str] = ("camera_matrix", "distortion_coefficients"), *,
                distortion: Any = DISTORTION, size: bool = True) -> str:  # fmt: skip
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    if size:
        storage.write("image_width", WIDTH)
        storage.write("image_height", HEIGHT)
    storage.write(names[0], PINHOLE.matrix)
    if distortion is not None:
        storage.write(names[1], np.array(distortion, float).reshape(-1, 1))
    storage.release()
    return str(path)


@pytest.mark.parametrize("name", ["camera.yml", "camera.yaml", "CAMERA.XML"])
@pytest.mark.parametrize(
    "names",
    [("camera_matrix", "distortion_coefficients"), ("Camera_Matrix", "Distortion_Coefficients"),
     ("cameraMatrix", "distCoeffs"), ("K", "D")],
)  # fmt: skip
def test_opencv_files_count_pixels_from_their_centres(tmp_path: Path, name: str, names: tuple[str, str]) -> None:
    camera = read_camera(opencv_file(tmp_path / name, names), WIDTH, HEIGHT)
    # OpenCV's calibration puts the centre of the top-left pixel at (0, 0), we put it at (0.5, 0.5).
    assert numbers(camera) == (900, 880, 650.5, 350.5)
    assert camera.distortion == DISTORTION


def test_opencv_files_of_short_long_or_no_distortion(tmp_path: Path) -> None:
    cases = {(-0.1, 0.2, 0.01, 0.02): (-0.1, 0.2, 0.01, 0.02, 0), (*DISTORTION, 0, 0, 0): DISTORTION, None: (0,) * 5}
    for stored, read in cases.items():
        spec = opencv_file(tmp_path / "camera.yml", distortion=stored, size=False)
        assert read_camera(spec, WIDTH, HEIGHT).distortion == read
    with pytest.raises(CameraError, match="rational"):
        read_camera(opencv_file(tmp_path / "camera.yml", distortion=(*DISTORTION, 0.1, 0, 0)), WIDTH, HEIGHT)


@pytest.mark.parametrize("tag", ["!!opencv-matrix\n   dt: d", ""])
def test_opencv_files_written_by_hand_may_use_whole_numbers(tmp_path: Path, tag: str) -> None:
    matrix = f"{tag}\n   rows: 3\n   cols: 3\n   data: [ 900, 0, 650., 0, 880, 350, 0, 0, 1 ]\n"
    spec = write(tmp_path / "camera.yml", f"%YAML:1.0\n---\ncamera_matrix: {matrix}")
    assert numbers(read_camera(spec, WIDTH, HEIGHT)) == (900, 880, 650.5, 350.5)


QTM = """<?xml version='1.0' encoding='UTF-8'?>
<calibration source="test"><cameras>{}</cameras></calibration>
"""
QTM_CAMERA = """<camera active="1" serial="{serial}">
  <fov_video left="{left}" top="{top}" right="{right}" bottom="{bottom}"/>
  <intrinsic focalLengthU="{fu}" focalLengthV="{fv}" centerPointU="{cu}" centerPointV="{cv}" skew="0"
    radialDistortion1="-0.11" radialDistortion2="0.07" radialDistortion3="0.003"
    tangentalDistortion1="0.001" tangentalDistortion2="-0.002"/>
</camera>"""


def qtm_camera(serial: str, fu: float = 900.0, left: int = 0, top: int = 0) -> str:
    return QTM_CAMERA.format(
        serial=serial, left=left, top=top, right=left + WIDTH - 1, bottom=top + HEIGHT - 1,
        fu=64 * fu, fv=64 * 880, cu=64 * (649.5 + left), cv=64 * (349.5 + top),
    )  # fmt: skip


@pytest.fixture
def qtm(tmp_path: Path) -> str:
    cameras = qtm_camera("cam01") + qtm_camera("cam02", fu=950.0) + qtm_camera("cam03", fu=970.0, left=64, top=32)
    return write(tmp_path / "rig.qca.txt", QTM.format(cameras))


@pytest.mark.parametrize(("name", "focal"), [("cam01", 900), ("cam02", 950), ("cam03", 970)])
def test_qtm_cameras_by_name(qtm: str, name: str, focal: float) -> None:
    camera = read_camera(f"{qtm}:{name}", WIDTH, HEIGHT)
    assert numbers(camera) == (focal, 880, 650, 350)
    assert (camera.width, camera.height) == (WIDTH, HEIGHT)
    assert camera.distortion == DISTORTION
    assert camera.source == f"file rig.qca.txt, camera {name}"


@pytest.mark.parametrize("ending", ["", ":cam04", ":"])
def test_a_qtm_file_without_a_right_name_lists_its_names(qtm: str, ending: str) -> None:
    with pytest.raises(CameraError, match=r"cam01, cam02, cam03.*rig\.qca\.txt:NAME"):
        read_camera(qtm + ending, WIDTH, HEIGHT)


def test_the_only_camera_of_a_qtm_file_needs_no_name(tmp_path: Path) -> None:
    spec = write(tmp_path / "one.qca.txt", QTM.format(qtm_camera("A7")))
    assert read_camera(spec, WIDTH, HEIGHT).fx == 900


@pytest.mark.parametrize("element", ["fov_video", "intrinsic"])
def test_a_qtm_camera_without_its_parts_is_refused(tmp_path: Path, element: str) -> None:
    spec = write(tmp_path / "rig.qca.txt", QTM.format(qtm_camera("A")).replace(element, "other"))
    with pytest.raises(CameraError, match="no intrinsics"):
        read_camera(spec, WIDTH, HEIGHT)


def test_entity_declarations_are_refused_before_they_grow(tmp_path: Path) -> None:
    levels = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))
    bomb = f'<!DOCTYPE c [<!ENTITY l0 "ha">{levels}]><calibration>&l11;</calibration>'
    harmless = QTM.format(qtm_camera("A")).replace("<calibration", '<!DOCTYPE c [<!ENTITY a "b">]><calibration', 1)
    for text in (bomb, harmless):
        with pytest.raises(CameraError, match="declares XML entities"):
            read_camera(write(tmp_path / "rig.qca.txt", text), WIDTH, HEIGHT)


# --- the video's size ---


@pytest.mark.parametrize(("width", "height"), [(640, 360), (2560, 1440), (1920, 1088)])
def test_a_scaled_copy_of_the_video_scales_the_camera(tmp_path: Path, width: int, height: int) -> None:
    """The same rays through the same places of the picture; 1088 is how codecs round 1080 up."""
    spec = json_file(tmp_path, distortion=DISTORTION)
    full, scaled = read_camera(spec, WIDTH, HEIGHT), read_camera(spec, width, height)
    assert (scaled.width, scaled.height) == (width, height)
    np.testing.assert_allclose(scaled.grid_rays(5, 7), full.grid_rays(5, 7), atol=1e-7)
    assert "scaled from 1280x720" in scaled.source


@pytest.mark.parametrize(("width", "height"), [(720, 1280), (1280, 800), (1024, 768), (1280, 700)])
def test_another_shape_of_picture_is_refused(tmp_path: Path, width: int, height: int) -> None:
    with pytest.raises(CameraError, match=f"1280x720 pixels but the video has {width}x{height}"):
        read_camera(json_file(tmp_path), width, height)


def test_a_principal_point_outside_the_picture_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CameraError, match="outside"):
        read_camera(json_file(tmp_path, cx=1500), WIDTH, HEIGHT)


# --- what is no camera ---


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    for spec in (tmp_path / "away.json", tmp_path, f"{tmp_path / 'away.qca.txt'}:cam01", ""):
        with pytest.raises(CameraError, match="no camera file at"):
            read_camera(str(spec), WIDTH, HEIGHT)


def test_a_windows_drive_is_no_camera_name(qtm: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(CameraError, match=r"no camera file at C:\\away\.json:"):
        read_camera(r"C:\away.json", WIDTH, HEIGHT)
    # Here a drive is a file name like any other, so that one can stand in for the other.
    folder = Path(qtm).parent
    monkeypatch.chdir(folder)
    Path(qtm).rename(folder / r"C:\rig.qca.txt")
    assert read_camera(r"C:\rig.qca.txt:cam02", WIDTH, HEIGHT).fx == 950
    with pytest.raises(CameraError, match="name one as"):
        read_camera(r"C:\rig.qca.txt", WIDTH, HEIGHT)


def test_a_file_with_a_colon_in_its_name_is_itself(tmp_path: Path) -> None:
    Path(json_file(tmp_path)).rename(tmp_path / "take:2.json")
    assert read_camera(str(tmp_path / "take:2.json"), WIDTH, HEIGHT).fx == 900


@pytest.mark.parametrize(
    "text",
    [
        "", "hello", "1 2 3\n4 5 6\n", "1 2\n3 4\n", "900 0 650\n0 880 350\n0 0 2\n", "-900 0 650\n0 880 350\n0 0 1",
        "nan 0 650\n0 880 350\n0 0 1", "900 0 nan\n0 880 350\n0 0 1", "900 0 0\n0 880 0\n650 350 1",
        "900 300 650\n0 880 350\n0 0 1", "900 0 650\n0 880 350\n0 0 1\n0 0 0",
    ],
)  # fmt: skip
def test_text_that_is_no_camera_matrix_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(CameraError):
        read_camera(write(tmp_path / "K.txt", text), WIDTH, HEIGHT)


@pytest.mark.parametrize(
    "changes",
    [
        {"fx": 0}, {"fx": -900}, {"fy": None}, {"fx": 1e999}, {"cx": float("nan")}, {"width": 0}, {"height": -720},
        {"width": 1e999}, {"distortion": [0.1, 0.2]}, {"distortion": None}, {"distortion": [0, 0, 0, 0, float("nan")]},
        {"fx": "wide"}, {"fx": 10**400}, {"camera": []}, {"camera": {"fx": 1}},
    ],
)  # fmt: skip
def test_json_that_is_no_camera_is_refused(tmp_path: Path, changes: dict[str, Any]) -> None:
    with pytest.raises(CameraError):
        read_camera(json_file(tmp_path, **changes), WIDTH, HEIGHT)


@pytest.mark.parametrize(
    ("name", "value"),
    [("focalLengthU", "0"), ("focalLengthV", "-1"), ("focalLengthU", "inf"), ("centerPointV", "nan"), ("right", "-1"),
     ("right", "nan"), ("bottom", "much"), ("radialDistortion1", "nan")],
)  # fmt: skip
def test_a_qtm_camera_with_impossible_numbers_is_refused(tmp_path: Path, name: str, value: str) -> None:
    text, count = re.subn(rf'{name}="[^"]*"', f'{name}="{value}"', QTM.format(qtm_camera("A")))
    assert count == 1
    with pytest.raises(CameraError):
        read_camera(write(tmp_path / "rig.qca.txt", text), WIDTH, HEIGHT)


@settings(max_examples=200)
@given(content=st.binary(max_size=60) | st.text(max_size=60).map(str.encode), data=st.data())
def test_garbage_is_refused_whatever_it_is_called(
    tmp_path_factory: pytest.TempPathFactory, content: bytes, data: st.DataObject
) -> None:
    name = data.draw(st.sampled_from(["c.json", "c.txt", "c.yml", "c.yaml", "c.xml", "c.qca.txt", "c.qca", "c"]))
    path = tmp_path_factory.mktemp("garbage") / name
    path.write_bytes(content)
    with pytest.raises(CameraError) as refusal:
        read_camera(str(path), WIDTH, HEIGHT)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "text",
    [
        "%YAML:1.0\n---\nother: 3\n", "%YAML:1.0\n---\ncamera_matrix: 5\n", "camera_matrix: [1, 2, 3]\n",
        "%YAML:1.0\n---\nK: !!opencv-matrix\n   rows: 1\n   cols: 3\n   dt: d\n   data: [ 9, 0, 6 ]\n",
        "%YAML:1.0\n---\ncamera_matrix: text\n",
    ],
)  # fmt: skip
def test_opencv_files_without_a_camera_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(CameraError):
        read_camera(write(tmp_path / "c.yml", text), WIDTH, HEIGHT)


# --- a real rig ---


@pytest.mark.shared
@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_the_lab_calibration_agrees_with_its_truth(shared_data: Path, number: int) -> None:
    calibration = shared_data / "clips" / "lab_two_people_calibration.qca.txt"
    with np.load(shared_data / "clips" / "lab_two_people_truth.npz") as truth:
        K, distortion, (width, height) = truth["K"][number - 1], truth["dist"][number - 1], truth["image_size"]
    camera = read_camera(f"{calibration}:cam0{number}", int(width), int(height))
    np.testing.assert_allclose(camera.distortion, distortion, atol=1e-9)
    # The truth's K counts pixels as OpenCV does, from the centre of the first one.
    np.testing.assert_allclose(numbers(camera), [K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5], atol=1e-5)
