"""Masks written in each form and read back."""

import json
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.extra import numpy as arrays

from core_solver.errors import UserError
from core_solver.perception.precomputed.masks import GivenMask, read_masks, to_label_grid
from core_solver.perception.precomputed.rle import decode_rle
from tests.solver.perception.precomputed.damage import damaged, value_or_user_error

IDS = np.zeros((12, 20), np.uint8)
IDS[2:6, 3:8], IDS[5:11, 10:19] = 1, 4


def write_png(path: Path, picture: np.ndarray) -> Path:
    path.parent.mkdir(exist_ok=True)
    assert cv2.imwrite(str(path), picture)
    return path


def runs(mask: np.ndarray) -> list[int]:
    flat = mask.T.ravel().astype(int)
    edges = np.flatnonzero(np.diff(flat, prepend=0))
    return np.diff([0, *edges, flat.size]).tolist()


def packed(counts: list[int]) -> str:
    """COCO's packing, written from its description."""
    text = ""
    for i, count in enumerate(counts):
        value = count - (counts[i - 2] if i > 2 else 0)
        more = True
        while more:
            bits, value = value & 31, value >> 5
            more = not ((value == 0 and not bits & 16) or (value == -1 and bits & 16))
            text += chr(48 + bits + (32 if more else 0))
    return text


def read_all(path: Path) -> list[tuple[int, int | None, np.ndarray]]:
    masks = read_masks(path)
    return [(n, m.identity, m.values) for n in sorted(masks.numbers) for m in masks.read(n)]


def test_pictures_of_ids(tmp_path: Path) -> None:
    write_png(tmp_path / "0003.png", IDS)
    write_png(tmp_path / "0005.png", np.zeros_like(IDS))
    masks = read_masks(tmp_path)
    assert masks.numbers == {3, 5}
    assert masks.size == (20, 12)
    assert masks.read(5) == ()
    one, four = masks.read(3)
    assert (one.identity, four.identity) == (1, 4)
    assert np.array_equal(one.values, 255 * (IDS == 1))
    assert np.array_equal(four.values, 255 * (IDS == 4))


def indexed_png(ids: np.ndarray, palette: list[tuple[int, int, int]]) -> bytes:
    def part(kind: bytes, body: bytes) -> bytes:
        return len(body).to_bytes(4, "big") + kind + body + zlib.crc32(kind + body).to_bytes(4, "big")

    height, width = ids.shape
    head = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, 3, 0, 0, 0])
    rows = b"".join(b"\0" + row.tobytes() for row in ids)
    colours = b"".join(map(bytes, palette))
    parts = part(b"IHDR", head) + part(b"PLTE", colours) + part(b"IDAT", zlib.compress(rows)) + part(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts


def test_pictures_with_a_palette_give_their_indices(tmp_path: Path) -> None:
    palette = [(0, 0, 0), (128, 0, 0), (0, 128, 0), (128, 128, 0), (0, 0, 128)]
    (tmp_path / "1.png").write_bytes(indexed_png(IDS, palette))
    assert [identity for _, identity, _ in read_all(tmp_path)] == [1, 4]


def test_coloured_and_deep_pictures_of_ids(tmp_path: Path) -> None:
    colours = np.zeros((12, 20, 3), np.uint8)
    colours[IDS == 1], colours[IDS == 4] = (0, 1, 0), (2, 0, 7)  # blue, green, red
    write_png(tmp_path / "a" / "1.png", colours)
    assert [identity for _, identity, _ in read_all(tmp_path / "a")] == [256, 2 * 65536 + 7]
    write_png(tmp_path / "b" / "1.png", IDS.astype(np.uint16) * 300)
    assert [identity for _, identity, _ in read_all(tmp_path / "b")] == [300, 1200]


@pytest.mark.parametrize("layout", ["person_{id}/f{frame:04d}.png", "f{frame:04d}_person_{id}.png"])
def test_a_picture_for_each_person(tmp_path: Path, layout: str) -> None:
    for person in (1, 4):
        for frame in (2, 30):
            write_png(
                tmp_path / layout.format(id=person, frame=frame), np.where(person == IDS, 255, 0).astype(np.uint8)
            )
    found = read_all(tmp_path)
    assert [(n, i) for n, i, _ in found] == [(2, 1), (2, 4), (30, 1), (30, 4)]
    assert np.array_equal(found[1][2], 255 * (IDS == 4))


@pytest.mark.parametrize("stored", [np.uint8(1), np.uint8(255), np.uint16(65535)])
def test_black_and_white_however_stored(tmp_path: Path, stored) -> None:
    write_png(tmp_path / "person_1" / "1.png", np.where(IDS == 1, stored, 0).astype(stored.dtype))
    ((_, _, values),) = read_all(tmp_path)
    assert np.array_equal(values, 255 * (IDS == 1))


@pytest.mark.parametrize("is_packed", [False, True])
def test_coco_run_lengths(tmp_path: Path, is_packed: bool) -> None:
    def entry(image: object, value: int, **more: object) -> dict[str, object]:
        counts = runs(value == IDS)
        segmentation = {"size": [12, 20], "counts": packed(counts) if is_packed else counts}
        return {"image_id": image, "category_id": 1, "segmentation": segmentation, **more}

    people = [
        entry("f9.png", 1, track_id=7),
        entry("f9.png", 4),
        entry("f12.png", 4),
        entry("f12.png", 1, category_id=3),
    ]
    (tmp_path / "masks.json").write_text(json.dumps(people))
    found = read_all(tmp_path)
    assert [(n, i) for n, i, _ in found] == [(9, 7), (9, None), (12, None)]
    assert np.array_equal(found[0][2], 255 * (IDS == 1))
    assert np.array_equal(found[2][2], 255 * (IDS == 4))


def test_a_packed_mask_that_is_known() -> None:
    """All of a picture, nothing of it, and a block of two pixels, worked out by hand."""
    assert decode_rle({"size": [2, 3], "counts": "06"}).all()
    assert not decode_rle({"size": [2, 3], "counts": "6"}).any()
    # Columns of 4: rows 1 and 2 of the second column of three.
    expected = np.zeros((4, 3), bool)
    expected[1:3, 1] = True
    assert np.array_equal(decode_rle({"size": [4, 3], "counts": "525"}), expected)


@given(arrays.arrays(bool, arrays.array_shapes(min_dims=2, max_dims=2, max_side=40)))
def test_run_lengths_come_back(mask: np.ndarray) -> None:
    counts = runs(mask)
    size = list(mask.shape)
    assert np.array_equal(decode_rle({"size": size, "counts": counts}), mask)
    assert np.array_equal(decode_rle({"size": size, "counts": packed(counts)}), mask)


@pytest.mark.parametrize(
    "segmentation",
    [
        None,
        [[1, 2, 3, 4, 5, 6]],
        {"size": [2, 3], "counts": [7]},
        {"size": [2, 3], "counts": [3, -1, 4]},
        {"size": [2, 3], "counts": "6P"},
        {"size": [0, 3], "counts": []},
        {"size": [10**9, 10**9], "counts": [10**18]},
    ],
)
def test_damaged_run_lengths_are_refused(tmp_path: Path, segmentation: object) -> None:
    file = tmp_path / "m.json"
    file.write_text(json.dumps([{"image_id": 1, "segmentation": segmentation}]))
    with pytest.raises(UserError, match=r"m\.json holds a damaged mask"):
        read_masks(file)


def test_what_is_no_folder_of_masks_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="nothing of the kind"):
        read_masks(tmp_path)
    write_png(tmp_path / "1.png", IDS)
    write_png(tmp_path / "2.png", IDS[:, :10])
    with pytest.raises(UserError, match=r"2\.png is 10x12, others are 20x12"):
        read_masks(tmp_path).read(2)
    (tmp_path / "a.json").write_text("[]")
    with pytest.raises(UserError, match="several kinds"):
        read_masks(tmp_path)


def test_shades_of_grey_are_no_ids(tmp_path: Path) -> None:
    write_png(tmp_path / "1.png", np.arange(240, dtype=np.uint8).reshape(12, 20))
    with pytest.raises(UserError, match="239 different values"):
        read_masks(tmp_path).read(1)


def test_masks_keep_their_place_on_the_label_grid() -> None:
    values = np.zeros((120, 200), np.uint8)
    values[30:60, 50:100] = 255
    grid = to_label_grid(GivenMask(values, None), (20, 12))
    assert grid.shape == (12, 20)
    assert (grid[3:6, 5:10] == 255).all()
    assert grid.sum() == 255 * 15


def test_a_picture_cut_off_is_refused(tmp_path: Path) -> None:
    """OpenCV alone would read it, half black."""
    whole = write_png(tmp_path / "1.png", IDS).read_bytes()
    for length in (0, 20, len(whole) // 2, len(whole) - 1):
        (tmp_path / "1.png").write_bytes(whole[:length])
        with pytest.raises(UserError, match=r"1\.png is a damaged or cut PNG"):
            read_masks(tmp_path)


ENTRY = {"image_id": "f3.png", "track_id": 2, "segmentation": {"size": [12, 20], "counts": packed(runs(IDS == 1))}}
WHOLE_JSON = json.dumps({"annotations": [ENTRY], "images": [{"id": 1, "file_name": "f3.png"}]}).encode()
WHOLE_PNG = cv2.imencode(".png", IDS)[1].tobytes()


def all_of(path: Path) -> list[np.ndarray]:
    masks = read_masks(path)
    return [mask.values for number in masks.numbers for mask in masks.read(number)]


@given(damaged(WHOLE_JSON))
@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_json_gives_a_line_or_masks(tmp_path: Path, content: bytes) -> None:
    for values in value_or_user_error(tmp_path / "m.json", content, all_of) or []:
        assert values.ndim == 2
        assert values.dtype == np.uint8


@given(damaged(WHOLE_PNG) | damaged(indexed_png(IDS, [(0, 0, 0), (9, 9, 9), (1, 2, 3), (4, 5, 6), (7, 8, 9)])))
@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_pictures_give_a_line_or_masks(tmp_path: Path, content: bytes) -> None:
    folder = tmp_path / "masks"
    folder.mkdir(exist_ok=True)
    for values in value_or_user_error(folder / "1.png", content, lambda path: all_of(path.parent)) or []:
        assert values.shape == IDS.shape
