"""The page as a file: self-contained, safe, repeatable, and whole or absent."""

import base64
import html
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from core_solver.cli import main
from core_solver.errors import UserError
from core_solver.progress import SilentProgress
from core_solver.report import footage as footage_module
from core_solver.report import write_report
from core_solver.report.footage import read_footage
from core_solver.take import write_take
from tests.solver.preview.takes import make_camera, make_take, write_video

FRAMES = 12
NASTY = '</script><script>alert(1)</script> & <b>"Zo\u00eb"</b> {{BLOCK}}'


class Outline(HTMLParser):
    """Elements with what they load, and the text of scripts by id."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.loaded: list[str] = []
        self.texts: dict[str, str] = {}
        self._open = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        values = dict(attrs)
        self.loaded += [v for k in ("src", "href", "data", "srcset") if (v := values.get(k))]
        self._open = values.get("id") or tag

    def handle_data(self, data):
        self.texts[self._open] = self.texts.get(self._open, "") + data


def report_of(tmp_path, take, video=None) -> str:
    write_take(tmp_path / "take.npz", take)
    write_report(tmp_path / "take.npz", video, tmp_path / "report.html", SilentProgress())
    return (tmp_path / "report.html").read_text(encoding="utf-8")


def document_of(text: str) -> dict:
    return json.loads(Outline(text).texts["document"])


def named(take, name: str):
    first = replace(take.people[0], name=name)
    meta = replace(take.meta, video_name=name, warnings=(name,), depth_source=name)
    return replace(take, meta=meta, people=(first, *take.people[1:]))


def test_the_page_loads_nothing(tmp_path):
    take = make_take()
    text = report_of(tmp_path, take, write_video(tmp_path / "clip.avi", take.meta.camera, FRAMES))
    assert set(Outline(text).loaded) == {"data:,"}
    assert "default-src 'none'" in text
    addresses = set(re.findall(r"https?://[\w./]+", text))
    assert addresses <= {"http://www.w3.org/2000/svg"}  # the name of SVG's elements, never fetched
    assert "@import" not in text
    assert not re.search(r"\bfetch\(|XMLHttpRequest|WebSocket|importScripts|sendBeacon", text)


def test_names_stay_text(tmp_path):
    plain = Outline(report_of(tmp_path, make_take()))
    text = report_of(tmp_path, named(make_take(), NASTY))
    nasty = Outline(text)
    assert nasty.tags == plain.tags
    assert "<script>alert" not in text
    assert nasty.texts["h1" if "h1" in nasty.texts else "title"].startswith(NASTY)
    document = document_of(text)
    assert document["people"][0]["name"] == document["title"] == NASTY
    assert html.escape(NASTY) in text


def test_no_mark_of_the_template_is_left(tmp_path):
    assert not re.findall(r"\{\{[A-Z]+\}\}", report_of(tmp_path, make_take()))


def test_the_same_input_gives_the_same_bytes(tmp_path):
    take = make_take()
    video = write_video(tmp_path / "clip.avi", take.meta.camera, FRAMES)
    assert report_of(tmp_path, take, video) == report_of(tmp_path, take, video)


def test_pictures_show_the_takes_frames(tmp_path):
    take = make_take(frames=3, first_frame=4, frame_step=3)
    camera = take.meta.camera
    writer = cv2.VideoWriter(
        str(tmp_path / "clip.avi"), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 25, (320, 240)
    )
    for number in range(FRAMES):
        writer.write(np.full((camera.height, camera.width, 3), 20 * number, np.uint8))
    writer.release()
    text = report_of(tmp_path, take, tmp_path / "clip.avi")
    footage = document_of(text)["footage"]
    data = base64.b64decode(Outline(text).texts["block"])[footage["data"]["at"] :]
    assert footage["frames"] == [0, 1, 2]
    assert (footage["width"], footage["height"]) == (320, 240)
    for index, number in enumerate([4, 7, 10]):
        file = np.frombuffer(data[footage["starts"][index] : footage["starts"][index + 1]], np.uint8)
        picture = cv2.imdecode(file, cv2.IMREAD_COLOR)
        assert picture is not None
        assert abs(float(picture.mean()) - 20 * number) < 3


def test_pictures_of_a_turned_video_stand_upright(tmp_path):
    writer = cv2.VideoWriter(
        str(tmp_path / "clip.avi"), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 25, (320, 240)
    )
    lying = np.zeros((240, 320, 3), np.uint8)
    lying[:, :160] = 255  # a quarter turn clockwise brings the left half to the top
    for _ in range(3):
        writer.write(lying)
    writer.release()
    take = make_take(make_camera(240, 320), frames=3)
    take = replace(take, meta=replace(take.meta, settings={"rotate": 90}))
    footage = read_footage(take, tmp_path / "clip.avi", SilentProgress())
    picture = cv2.imdecode(np.frombuffer(footage.pictures[0], np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape == (320, 240, 3)
    assert picture[:150].mean() > 250
    assert picture[170:].mean() < 5


def noise_video(path, frames: int):
    camera = make_camera(640, 480)
    rng = np.random.default_rng(0)
    writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 25, (640, 480))
    for _ in range(frames):
        writer.write(rng.integers(0, 256, (480, 640, 3)).astype(np.uint8))
    writer.release()
    return camera


def test_pictures_shrink_until_they_fit(tmp_path, monkeypatch):
    camera = noise_video(tmp_path / "noise.avi", FRAMES)
    take = make_take(camera, frames=FRAMES)
    whole = read_footage(take, tmp_path / "noise.avi", SilentProgress())
    assert (whole.width, whole.height) == (640, 480)
    monkeypatch.setattr(footage_module, "BYTES", 400_000)
    small = read_footage(take, tmp_path / "noise.avi", SilentProgress())
    assert sum(map(len, small.pictures)) <= 400_000 < sum(map(len, whole.pictures))
    assert small.width / small.height == pytest.approx(640 / 480, rel=0.01)


def test_the_budget_keeps_300_frames_below_25_megabytes():
    assert footage_module.BYTES * 4 / 3 < 21e6  # as base64; bodies, cloud and measures take the rest


def test_long_takes_show_every_nth_picture(tmp_path, monkeypatch):
    monkeypatch.setattr(footage_module, "_MOST_PICTURES", 5)
    take = make_take()
    video = write_video(tmp_path / "clip.avi", take.meta.camera, FRAMES)
    assert read_footage(take, video, SilentProgress()).frames == (0, 3, 6, 9)


def test_without_video_the_page_says_so(tmp_path):
    document = document_of(report_of(tmp_path, make_take()))
    assert document["footage"] is None
    assert "--video" in document["no_footage"]
    assert "take.work" in document["no_reprojection"]


def test_people_of_one_body_share_its_mesh(tmp_path):
    take = make_take()
    crowd = tuple(replace(take.people[i % 2], id=i + 1) for i in range(20))
    document = document_of(report_of(tmp_path, replace(take, people=crowd)))
    assert len(document["people"]) == 20
    assert len(document["meshes"]) == 1


@pytest.mark.parametrize("frames", [1, 2])
def test_short_takes_without_people_or_cloud(tmp_path, frames):
    take = make_take(frames=frames)
    scene = replace(take.scene, points=np.zeros((0, 3), np.float32), colors=np.zeros((0, 3), np.uint8))
    document = document_of(report_of(tmp_path, replace(take, people=(), scene=scene)))
    assert document["people"] == []
    assert {"Nobody is in this take.", "The take holds no cloud of the scene."} <= {
        finding["text"] for finding in document["findings"]
    }


@pytest.mark.parametrize("name", ["report.npz", "report", "folder.html"])
def test_names_that_are_no_page_are_refused(tmp_path, name):
    (tmp_path / "folder.html").mkdir()
    write_take(tmp_path / "report.npz", make_take())
    before = (tmp_path / "report.npz").read_bytes()
    with pytest.raises(UserError, match=r"\.html"):
        write_report(tmp_path / "report.npz", None, tmp_path / name, SilentProgress())
    assert (tmp_path / "report.npz").read_bytes() == before


def test_the_command_and_its_complaints(tmp_path, capsys):
    take, output = make_take(), tmp_path / "report.html"
    path = tmp_path / "take.npz"
    write_take(path, take)
    own = write_video(tmp_path / "clip.avi", take.meta.camera, FRAMES)
    assert main(["report", str(path), "--video", str(own), "-o", str(output)]) == 0
    assert str(output) in capsys.readouterr().out
    before = output.read_bytes()
    other = write_video(tmp_path / "other.avi", make_camera(300, 240), FRAMES)
    short = write_video(tmp_path / "short.avi", take.meta.camera, 4)
    (tmp_path / "text.mp4").write_text("no video")
    for arguments, word in [
        ([str(path), "--video", str(other)], "300x240"),
        ([str(path), "--video", str(short)], "ends before"),
        ([str(path), "--video", str(tmp_path / "none.mp4")], "no video"),
        ([str(path), "--video", str(tmp_path / "text.mp4")], "not a video"),
        ([str(tmp_path / "none.npz")], "no such file"),
    ]:
        assert main(["report", *arguments, "-o", str(output)]) == 2
        complaint = capsys.readouterr().err.strip().splitlines()[-1]
        assert complaint.startswith("error: ")
        assert word in complaint
    assert output.read_bytes() == before
    assert sorted(p.name for p in tmp_path.glob(".*")) == []


def test_a_place_that_cannot_be_written(tmp_path, capsys):
    write_take(tmp_path / "take.npz", make_take())
    (tmp_path / "file").write_text("")
    output = tmp_path / "file" / "report.html"
    assert main(["report", str(tmp_path / "take.npz"), "-o", str(output)]) == 2
    assert "cannot write" in capsys.readouterr().err
