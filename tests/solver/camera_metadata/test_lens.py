"""Files with known metadata, written by hand and by FFmpeg; then files that are broken in every way."""

import math
import shutil
import struct
import subprocess
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from core_solver.camera_metadata import camera_from_metadata, stored_lens
from core_solver.camera_metadata.exif import find_exif
from tests.solver.camera_metadata import movies

WIDTH, HEIGHT = 1920, 1080
APPLE = movies.keyed_meta(
    {
        "com.apple.quicktime.make": movies.data(1, b"Apple"),
        movies.APPLE_LENS: movies.data(1, b"back camera 5.1mm f/1.6"),
        movies.APPLE_FOCAL: movies.data(21, b"\0\0\0\x1b"),
    }
)


def written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def focal_mm(content: bytes, path: Path) -> float:
    """What a file says, in millimetres of a 36 mm wide film; 0 where it says nothing."""
    lens = stored_lens(written(path / "clip.mov", content), WIDTH, HEIGHT)
    return lens.focal * 36 if lens else 0.0


@pytest.mark.parametrize(
    "inside",
    [
        APPLE,
        movies.box(b"trak", APPLE),
        movies.box(b"udta", APPLE),
        movies.keyed_meta({movies.APPLE_FOCAL: movies.data(21, b"\x1b")}, is_full=True),
        movies.keyed_meta({movies.APPLE_FOCAL: movies.data(1, b"27.00mm")}),
        movies.keyed_meta({movies.APPLE_FOCAL: movies.data(23, struct.pack(">f", 27))}),
        movies.keyed_meta({movies.APPLE_FOCAL: movies.data(76, struct.pack(">H", 27))}),
        movies.box(b"udta", movies.box(b"CNTH", movies.box(b"CNDA", b"\xff\xd8\xff\xe1\0\0", movies.exif(27)))),
        movies.box(b"uuid", bytes(16), movies.exif(27, order=">")),
        movies.box(b"uuid", bytes(16), movies.exif(9, zoom=(3, 1))),
        movies.box(b"uuid", bytes(16), movies.exif(27, zoom=(3, 1), make="Apple")),
        movies.box(b"uuid", bytes(16), movies.exif(27, zoom=(3, 0))),
    ],
)
def test_an_equivalent_focal_length_is_found_wherever_makers_put_it(tmp_path: Path, inside: bytes) -> None:
    assert focal_mm(movies.movie(inside), tmp_path) == pytest.approx(27)


@pytest.mark.parametrize("size", [(1920, 1080), (1080, 1920), (640, 480)])
def test_the_longer_side_is_36_mm_wide_however_the_picture_is_turned(tmp_path: Path, size: tuple[int, int]) -> None:
    found = camera_from_metadata(written(tmp_path / "a.mov", movies.movie(APPLE)), *size)
    assert found is not None
    camera = found.camera
    assert camera.fx == camera.fy == pytest.approx(27 / 36 * max(size))
    assert (camera.cx, camera.cy) == (size[0] / 2, size[1] / 2)
    assert camera.source == "metadata: 35 mm equivalent focal length 27 mm (back camera 5.1mm f/1.6)"
    assert 0.05 < found.focal_sigma < 0.15


def test_a_spatial_video_states_its_field_of_view(tmp_path: Path) -> None:
    found = camera_from_metadata(
        written(tmp_path / "a.mov", movies.movie(movies.spatial_track(63.4, 2200, 2200))), 2200, 2200
    )
    assert found is not None
    assert found.camera.fov_degrees == pytest.approx(63.4, abs=0.01)
    assert found.focal_sigma < 0.05


def test_gopro_linear_is_a_pinhole_and_wide_is_not(tmp_path: Path) -> None:
    linear, wide = (
        stored_lens(written(tmp_path / "a.mp4", movies.movie(movies.gopro_udta(92.0, mode))), WIDTH, HEIGHT)
        for mode in (b"L", b"W")
    )
    assert linear is not None
    assert wide is not None
    half_diagonal = math.hypot(WIDTH, HEIGHT) / 2
    assert 2 * math.degrees(math.atan(half_diagonal / (linear.focal * WIDTH))) == pytest.approx(92, abs=0.1)
    assert wide.sigma > 2 * linear.sigma
    assert "fisheye" in wide.source


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg makes this test's video")
def test_a_real_file_with_keyed_metadata(tmp_path: Path) -> None:
    path = tmp_path / "real.mp4"
    make = ["ffmpeg", "-v", "error", "-f", "lavfi", "-i", "testsrc=s=64x48:d=0.3:r=10", "-movflags"]
    make += ["use_metadata_tags", "-metadata", f"{movies.APPLE_FOCAL}=31", str(path)]
    subprocess.run(make, check=True, timeout=60)
    lens = stored_lens(path, 64, 48)
    assert lens is not None
    assert lens.focal * 36 == pytest.approx(31)


def test_the_media_are_not_read(tmp_path: Path) -> None:
    """A sparse file of 8 GB: only by passing over it can the movie header behind it be found at once."""
    path, media = tmp_path / "long.mov", 8 << 30
    with path.open("wb") as file:
        file.write(struct.pack(">I4sQ", 1, b"mdat", media))
        file.seek(media)
        file.write(movies.movie(APPLE)[12:])
    lens = stored_lens(path, WIDTH, HEIGHT)
    assert lens is not None
    assert lens.focal * 36 == pytest.approx(27)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"RIFF\0\0\0\0AVI LIST",
        bytes(64),
        movies.movie(),
        movies.movie(movies.keyed_meta({movies.APPLE_LENS: movies.data(1, b"somebody's lens 5.7mm")})),
        movies.movie(movies.keyed_meta({movies.APPLE_FOCAL: movies.data(21, b"\0")})),
        movies.movie(movies.keyed_meta({movies.APPLE_FOCAL: movies.data(22, b"\xff\xff")})),
        movies.movie(movies.keyed_meta({movies.APPLE_FOCAL: movies.data(23, struct.pack(">f", math.nan))})),
        movies.movie(movies.keyed_meta({movies.APPLE_FOCAL: movies.data(23, struct.pack(">f", math.inf))})),
        movies.movie(movies.keyed_meta({movies.APPLE_FOCAL: movies.data(1, b"normal")})),
        movies.movie(movies.gopro_udta(math.nan, b"L")),
        movies.movie(movies.box(b"uuid", bytes(16), movies.exif(0))),
        movies.box(b"ftyp", b"qt  ") + movies.box(b"mdat", APPLE),
        movies.box(b"moov", b"".join([struct.pack(">I4s", 8, b"trak")] * 20_000) + APPLE),
    ],
)
def test_what_says_nothing_believable_gives_no_lens(tmp_path: Path, content: bytes) -> None:
    assert focal_mm(content, tmp_path) == 0


def test_a_missing_file_gives_no_lens(tmp_path: Path) -> None:
    assert stored_lens(tmp_path / "nothing.mp4", WIDTH, HEIGHT) is None


def test_boxes_without_end_are_given_up(tmp_path: Path) -> None:
    nested = APPLE
    for _ in range(200):
        nested = movies.box(b"meta", nested)
    assert focal_mm(movies.movie(nested), tmp_path) == 0
    assert focal_mm(movies.movie(movies.large_box(b"udta", APPLE)), tmp_path) == pytest.approx(27)


WHOLE = movies.movie(
    APPLE, movies.gopro_udta(92, b"L"), movies.spatial_track(63, 1920, 1080), movies.box(b"uuid", movies.exif(27)),
    media=10,
)  # fmt: skip


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0, len(WHOLE) - 1), new=st.binary(min_size=1, max_size=8), cut=st.booleans())
def test_damage_never_raises(tmp_path: Path, place: int, new: bytes, cut: bool) -> None:
    content = WHOLE[:place] if cut else WHOLE[:place] + new + WHOLE[place + len(new) :]
    lens = stored_lens(written(tmp_path / "broken.mov", content), WIDTH, HEIGHT)
    assert lens is None or 0.2 <= lens.focal <= 8


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=400), kind=st.sampled_from([b"keys", b"ilst", b"GPMF", b"stsd", b"uuid", b"meta"]))
def test_noise_in_a_box_never_raises(tmp_path: Path, content: bytes, kind: bytes) -> None:
    noisy = movies.movie(movies.box(b"udta", movies.box(kind, content)), movies.box(b"trak", movies.box(kind, content)))
    stored_lens(written(tmp_path / "noise.mov", noisy), WIDTH, HEIGHT)


@settings(max_examples=200)
@given(content=st.binary(max_size=300), order=st.sampled_from([b"II*\0", b"MM\0*"]))
def test_noise_in_exif_never_raises(content: bytes, order: bytes) -> None:
    find_exif(b"Exif\0\0" + order + content)
    find_exif(order + content)
