"""The page in a real browser: what people do with it, and what it must never do."""

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from core_solver.camera import camera_from_model
from core_solver.preview.bodies import PosablePerson
from core_solver.progress import SilentProgress
from core_solver.report import write_report
from core_solver.take import write_take
from tests.solver.preview.takes import make_take, write_video
from tests.solver.report.browser import Browser, chromium, find_chromium

pytestmark = pytest.mark.browser
FRAMES = 50
DRAWN = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))"
NASTY = "<img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def program() -> str:
    found = find_chromium()
    if found is None:
        pytest.skip("no Chromium is installed")
    return found


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, Path]:
    """Reports of an ordinary take and of odd ones."""
    folder = tmp_path_factory.mktemp("pages")
    take = make_take(frames=FRAMES)
    contacts = np.zeros((FRAMES, 2), np.float32)
    contacts[10:30, 0] = 1
    take = replace(take, people=(replace(take.people[0], contacts=contacts, name=NASTY), *take.people[1:]))
    video = write_video(folder / "clip.avi", take.meta.camera, FRAMES)
    empty = replace(take.scene, points=np.zeros((0, 3), np.float32), colors=np.zeros((0, 3), np.uint8))
    crowd = tuple(replace(take.people[i % 2], id=i + 1, name=f"Person {i + 1}") for i in range(20))
    single = make_take(frames=1)
    takes = {
        "whole": (take, video),
        "no_cloud": (replace(take, scene=empty), None),
        "nobody": (replace(take, people=(), scene=empty), None),
        "one_frame": (single, None),
        "crowd": (replace(take, people=crowd), None),
    }
    for name, (one, footage) in takes.items():
        write_take(folder / f"{name}.npz", one)
        write_report(folder / f"{name}.npz", footage, folder / f"{name}.html", SilentProgress())
    return {name: folder / f"{name}.html" for name in takes}


@pytest.fixture(scope="module")
def running(program, tmp_path_factory):
    with chromium(program, tmp_path_factory.mktemp("profile")) as browser:
        yield browser


@pytest.fixture
def tab(running: Browser, pages):
    """The ordinary page, opened afresh; afterwards it must have been silent and alone."""
    running.complaints.clear()
    running.requests.clear()
    running.open(pages["whole"])
    running.wait_for("report.shownPicture() === 0")
    yield running
    assert running.complaints == []
    assert running.requests == [pages["whole"].resolve().as_uri()]


def frame(tab: Browser) -> int:
    return tab.value("report.state.frame")


def view(tab: Browser) -> dict:
    return tab.value("report.state.view")


def test_keys_step_and_jump(tab):
    for key, shift, expected in [
        ("ArrowRight", False, 1), ("ArrowRight", True, 11), ("ArrowLeft", False, 10), ("End", False, FRAMES - 1),
        ("ArrowRight", False, FRAMES - 1), ("Home", False, 0), ("ArrowLeft", False, 0),
    ]:  # fmt: skip
        tab.press(key, shift=shift)
        assert frame(tab) == expected


def test_space_plays_in_the_takes_own_time_and_stops(tab):
    tab.press(" ")
    assert tab.value("report.state.playing")
    tab.wait_for("report.state.frame >= 5")
    tab.press(" ")
    assert not tab.value("report.state.playing")
    milliseconds, reached = tab.value(
        "new Promise(done => { report.seek(0); const start = performance.now(); report.play(); const look = () => {"
        "if (report.state.frame < 12) return requestAnimationFrame(look);"
        "done([performance.now() - start, report.state.frame]); }; look(); })"
    )
    # However slow the machine draws, the frame belongs to the time that has passed: 25 a second.
    assert reached / 25 <= milliseconds / 1000 + 0.01
    assert reached / 25 > milliseconds / 1000 - 0.5


def test_play_button_and_speed(tab):
    tab.value("document.getElementById('speed').value = '2'")
    tab.value("document.getElementById('speed').dispatchEvent(new Event('change'))")
    assert tab.value("report.state.speed") == 2
    tab.click(tab.centre("#play"))
    tab.wait_for("document.getElementById('play').getAttribute('aria-label') === 'Pause'")
    tab.wait_for("report.state.frame > 3")
    tab.click(tab.centre("#play"))
    assert not tab.value("report.state.playing")


def test_the_timeline_scrubs_and_everything_follows(tab):
    left, y, width = tab.value(
        "(() => { const b = document.getElementById('scrub').getBoundingClientRect();"
        "return [b.left, b.top + b.height / 2, b.width]; })()"
    )
    tab.drag((left + 0.1 * width, y), (left + 0.5 * width, y))
    middle = frame(tab)
    assert abs(middle - (FRAMES - 1) / 2) <= 1
    tab.wait_for(f"report.shownPicture() === {middle}")
    assert tab.value("document.getElementById('number').value") == str(middle)
    assert f"{middle / 25:.2f}" in tab.value("document.getElementById('clock').textContent")
    cursors = tab.value("[...document.querySelectorAll('.chart .cursor')].map(c => c.style.transform)")
    assert len(cursors) == 5  # the sixth chart says why there is none
    assert len(set(cursors)) == 1


def test_charts_scrub_too(tab):
    tab.centre(".chart svg")
    left, y, width = tab.value(
        "(() => { const b = document.querySelector('.chart svg').getBoundingClientRect();"
        "return [b.left, b.top + b.height / 2, b.width]; })()"
    )
    tab.click((left + width - 9, y))
    assert frame(tab) >= FRAMES - 2


def test_the_mouse_orbits_zooms_and_moves(tab):
    x, y = tab.centre("#space-view canvas")
    before = view(tab)
    tab.drag((x, y), (x + 120, y + 40))
    turned = view(tab)
    assert turned["yaw"] != before["yaw"]
    assert turned["pitch"] > before["pitch"]
    assert turned["distance"] == before["distance"]
    tab.wheel((x, y), -300)
    tab.wait_for(f"report.state.view.distance < {turned['distance']}")
    assert view(tab)["yaw"] == turned["yaw"]


def test_keys_orbit_and_zoom(tab):
    before = view(tab)
    for key in "aw+":
        tab.press(key)
    after = view(tab)
    assert after["yaw"] > before["yaw"]
    assert after["pitch"] > before["pitch"]
    assert after["distance"] < before["distance"]
    assert frame(tab) == 0


def test_fingers_orbit_and_pinch(running, pages):
    running.open(pages["whole"], 390, 844, touch=True)
    x, y = running.centre("#space-view canvas")
    before = view(running)
    running.touch([(x, y)], [(x + 30, y)], [(x + 60, y)])
    turned = view(running)
    assert turned["yaw"] != before["yaw"]
    running.touch([(x - 20, y), (x + 20, y)], [(x - 40, y), (x + 40, y)], [(x - 80, y), (x + 80, y)])
    assert view(running)["distance"] < 0.5 * turned["distance"]
    assert running.value("document.documentElement.scrollWidth") <= 390  # nothing sticks out on a phone


def test_the_camera_view_is_the_footage(tab):
    tab.value("[...document.querySelectorAll('#viewpoints button')].find(b => b.textContent === 'Camera').click()")
    # Without its lens' distortion the footage is a picture of the 3D view's middle, in another size.
    shown, height = tab.value(
        "[[7, 15, 20, 0].map(j => report.project([...report.people[1].joints.slice(3 * j, 3 * j + 3)])),"
        "document.querySelector('#space-view canvas').clientHeight]"
    )
    take = make_take(frames=FRAMES)
    camera = camera_from_model(take.meta.camera)
    joints = PosablePerson(take.people[1]).joints()[0, [7, 15, 20, 0]]
    pixels = camera.project(joints, distorted=False) * height / camera.height
    np.testing.assert_allclose(np.diff(np.array(shown)[:, :2], axis=0), np.diff(pixels, axis=0), atol=0.5)


def test_people_are_chosen_by_card_key_and_click(tab):
    tab.click(tab.centre(".person:nth-child(2)"))
    assert tab.value("report.state.person") == 1
    tab.wait_for("document.querySelector('.person:nth-child(2) .pick').getAttribute('aria-pressed') === 'true'")
    tab.press("1")
    assert tab.value("report.state.person") == 0
    tab.press("0")
    assert tab.value("report.state.person") is None
    tab.centre("#space-view canvas")
    left, top = tab.value(
        "(() => { const b = document.querySelector('#space-view canvas').getBoundingClientRect();"
        "return [b.left, b.top]; })()"
    )
    x, y, *_ = tab.value("report.project([...report.people[1].joints.slice(45, 48)])")
    tab.click((left + x, top + y))
    assert tab.value("report.state.person") == 1


def test_a_finding_leads_to_its_frames(tab):
    said = tab.value("[...document.querySelectorAll('.findings .said')].map(e => e.textContent)")
    assert any(re.search(r"Person 2 is not seen after frame 24", text) for text in said)
    tab.value("[...document.querySelectorAll('.findings button')].find(b => b.textContent === '25').click()")
    assert frame(tab) == 25
    assert tab.value("report.state.person") == 1
    tab.wait_for("[...document.querySelectorAll('.findings li.now')].some(e => e.textContent.includes('after frame'))")


def test_names_are_text(tab):
    assert tab.value("document.querySelector('.person .name').textContent") == NASTY
    assert tab.value("document.images.length") == 0


def test_contacts_are_shown(tab):
    for number, pressed in [(5, False), (20, True)]:
        tab.value(f"report.seek({number})")
        tab.wait_for(f"document.querySelector('.person .foot').classList.contains('rests') === {str(pressed).lower()}")


def test_the_lens_is_the_takes_lens(tab):
    take = make_take(frames=FRAMES)
    head = PosablePerson(take.people[1]).joints()[7, 15]
    expected = camera_from_model(take.meta.camera).project(head)
    shown = tab.value(
        "report.throughLens([...report.people[1].joints.slice((7 * 24 + 15) * 3, (7 * 24 + 15) * 3 + 3)])"
    )
    np.testing.assert_allclose(shown[:2], expected, atol=0.05)
    assert shown[2] == pytest.approx(head[2], abs=1e-3)


def test_bodies_are_drawn_over_the_footage_where_they_are(tab):
    take = make_take(frames=FRAMES)
    chest = PosablePerson(take.people[0]).joints()[0, 9]
    u, v = camera_from_model(take.meta.camera).project(chest)
    tab.value("document.getElementById('opacity').value = 100")
    tab.value("document.getElementById('opacity').dispatchEvent(new Event('input'))")
    left, top, scale = tab.value(
        "(() => { const b = document.getElementById('footage-frame').getBoundingClientRect();"
        f"return [b.left, b.top, b.width / {take.meta.camera.width}]; }})()"
    )
    tab.value(DRAWN)
    picture = cv2.imdecode(np.frombuffer(tab.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    blue, green, red = picture[int(top + scale * v), int(left + scale * u)].astype(int)
    assert red > 2 * blue
    assert red > 2 * green
    corner = picture[int(top + 0.9 * scale * 240), int(left + 0.95 * scale * 320)].astype(int)
    assert np.ptp(corner) < 12  # grey footage


@pytest.mark.parametrize("name", ["no_cloud", "nobody", "one_frame", "crowd"])
def test_odd_takes_show_without_complaint(running, pages, name):
    running.complaints.clear()
    running.requests.clear()
    running.open(pages[name])
    running.value("report.play()")
    running.wait_for("report.state.frame > 0 || report.frameCount === 1")
    running.value("report.pause()")
    running.press("End")
    running.value("report.choose(0)")
    running.value(DRAWN)
    assert running.value("report.state.frame") == running.value("report.frameCount") - 1
    assert running.complaints == []
    assert running.requests == [pages[name].resolve().as_uri()]


def test_without_webgl_the_people_are_sketched(program, pages, tmp_path):
    with chromium(program, tmp_path, "--disable-3d-apis") as browser:
        browser.open(pages["whole"])
        assert browser.value("report.kind()") == "canvas"
        colours = (
            "(() => { const c = document.querySelector('#space-view canvas');"
            "const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; let red = 0, blue = 0;"
            "for (let i = 0; i < d.length; i += 4) { if (d[i] > 200 && d[i + 2] < 60) red++;"
            "if (d[i + 2] > 200 && d[i] < 60) blue++; } return [red, blue]; })()"
        )
        browser.value(DRAWN)
        assert min(browser.value(colours)) > 50
        x, y = browser.centre("#space-view canvas")
        before = view(browser)
        browser.drag((x, y), (x + 100, y))
        assert view(browser)["yaw"] != before["yaw"]
        assert browser.complaints == []
