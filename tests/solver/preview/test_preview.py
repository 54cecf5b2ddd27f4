from dataclasses import replace

import cv2
import numpy as np
import pytest

from core_solver.errors import UserError, VideoError
from core_solver.preview import write_preview
from core_solver.preview.bodies import PosablePerson
from core_solver.preview.overlay import TakeOverFootage
from core_solver.progress import SilentProgress
from tests.solver.body.synthetic import make_stick_body
from tests.solver.preview.takes import (
    BLUE,
    CAMERA_HEIGHT,
    RED,
    make_camera,
    make_person,
    make_take,
    project_by_hand,
    write_video,
)

GREY = 128


def frames_of(path):
    capture = cv2.VideoCapture(str(path))
    pictures = []
    while True:
        fine, picture = capture.read()
        if not fine:
            return pictures
        pictures.append(picture)


def pictures_of(take, video, frames):
    return list(TakeOverFootage(take, video).pictures(frames))


def is_coloured(pixel, colour) -> bool:
    """Whether the pixel's strongest channel is the colour's, well above the others (BGR against RGB)."""
    strongest = int(np.argmax(colour[::-1]))
    rest = np.delete(pixel.astype(int), strongest)
    return int(pixel[strongest]) > rest.max() + 30


def torso_point(take, person, frame):
    """The middle of the chest by hand: SMPL's y is up, the camera's is down, and the person faces the camera."""
    at = take.people[person]
    rest = at.rest_joints[9]
    root = at.rest_joints[0]
    return (rest - root) * (1, -1, -1) + root + at.gamma[frame]


@pytest.mark.parametrize(("width", "height"), [(320, 240), (321, 241), (180, 320)])
def test_files_frames_and_even_sizes(tmp_path, width, height):
    take = make_take(make_camera(width, height))
    video = write_video(tmp_path / "clip.avi", take.meta.camera, 12)
    overlay, overview = write_preview(take, video, tmp_path / "new" / "dir", SilentProgress())
    pictures = frames_of(overlay)
    assert len(pictures) == 12
    assert pictures[0].shape == (height + height % 2, width + width % 2, 3)
    assert cv2.imread(str(overview)).shape[1] == 1920
    assert sorted(p.name for p in overlay.parent.iterdir()) == ["overlay.mp4", "overview.png"]


def test_the_overlay_lasts_as_long_as_a_video_of_uneven_frames(tmp_path):
    take = make_take()
    times = np.arange(12) / 25 + np.where(np.arange(12) > 5, 0.4, 0)
    video = write_video(tmp_path / "clip.avi", take.meta.camera, 12)
    overlay, _ = write_preview(replace(take, times=times), video, tmp_path, SilentProgress())
    rate = cv2.VideoCapture(str(overlay)).get(cv2.CAP_PROP_FPS)
    assert 11 / rate == pytest.approx(times[-1] - times[0], rel=0.01)


def test_bodies_lie_where_an_independent_projection_puts_them(tmp_path):
    take = make_take()
    video = write_video(tmp_path / "clip.avi", take.meta.camera, 12)
    for frame, picture in zip((0, 5), pictures_of(take, video, (0, 5)), strict=True):
        for person, colour in enumerate((RED, BLUE)):
            u, v = project_by_hand(torso_point(take, person, frame), take.meta.camera)
            assert is_coloured(picture[int(v), int(u)], colour)
        assert np.all(np.abs(picture[40, 5].astype(int) - GREY) < 3)


def test_the_outline_ends_at_the_crown_and_the_soles(tmp_path):
    take = make_take(people=(make_person(make_stick_body(), 1, RED, (0.0, 4.0), (0, 0), 3),), frames=3)
    video = write_video(tmp_path / "clip.avi", take.meta.camera, 3)
    picture = pictures_of(take, video, (0,))[0]
    vertices = PosablePerson(take.people[0]).vertices(0)
    pixels = np.array([project_by_hand(vertex, take.meta.camera) for vertex in vertices])
    red = (picture[..., 2].astype(int) > picture[..., :2].max(axis=-1).astype(int) + 30)[60:]
    rows = np.flatnonzero(red.any(axis=1)) + 60
    columns = np.flatnonzero(red.any(axis=0))
    assert vertices[:, 1].max() == pytest.approx(CAMERA_HEIGHT, abs=1e-4)
    assert rows[-1] + 1 == pytest.approx(pixels[:, 1].max(), abs=1.5)
    assert columns[0] == pytest.approx(pixels[:, 0].min(), abs=1.5)
    assert columns[-1] + 1 == pytest.approx(pixels[:, 0].max(), abs=1.5)


def test_nearer_people_hide_farther_ones_whatever_their_order(tmp_path):
    body = make_stick_body()
    near = make_person(body, 1, RED, (0.0, 3.0), (0, 0), 3)
    far = make_person(body, 2, BLUE, (0.0, 4.0), (0, 0), 3)
    for people in ((near, far), (far, near)):
        take = make_take(people=people, frames=3)
        video = write_video(tmp_path / "clip.avi", take.meta.camera, 3)
        u, v = project_by_hand(torso_point(take, people.index(near), 0), take.meta.camera)
        assert is_coloured(pictures_of(take, video, (0,))[0][int(v), int(u)], RED)


def test_frames_without_evidence_are_fainter(tmp_path):
    body = make_stick_body()
    valid = np.array([True, False, True])
    take = make_take(people=(make_person(body, 1, RED, (0.0, 3.0), (0, 0), 3, valid=valid),), frames=3)
    video = write_video(tmp_path / "clip.avi", take.meta.camera, 3)
    seen, filled = pictures_of(take, video, (0, 1))
    strength = [np.abs(p[60:200].astype(float) - GREY).mean() for p in (seen, filled)]
    assert 0.1 * strength[0] < strength[1] < 0.7 * strength[0]


def test_nobody_is_drawn_before_their_first_and_after_their_last_sight(tmp_path):
    body = make_stick_body()
    valid = np.array([False, True, True, False])
    take = make_take(people=(make_person(body, 1, RED, (0.0, 3.0), (0, 0), 4, valid=valid),), frames=4)
    video = write_video(tmp_path / "clip.avi", take.meta.camera, 4)
    pictures = pictures_of(take, video, range(4))
    drawn = [bool((np.abs(p[60:200].astype(float) - GREY) > 40).any()) for p in pictures]
    assert drawn == [False, True, True, False]


def test_behind_the_camera_and_far_outside_nothing_is_drawn(tmp_path):
    body = make_stick_body()
    people = (
        make_person(body, 1, RED, (0.0, -3.0), (0, 0), 3),
        make_person(body, 2, BLUE, (80.0, 3.0), (0, 0), 3),
        make_person(body, 3, RED, (0.0, 0.0), (0, 0), 3),
    )
    take = make_take(people=people, frames=3)
    video = write_video(tmp_path / "clip.avi", take.meta.camera, 3)
    picture = pictures_of(take, video, (0,))[0]
    assert np.all(np.abs(picture[40:120, 20:120].astype(int) - GREY) < 3)
    write_preview(take, video, tmp_path / "out", SilentProgress())


def test_the_takes_frames_are_found_in_the_video(tmp_path):
    take = make_take(frames=4, first_frame=3, frame_step=2)
    video = write_video(tmp_path / "clip.avi", take.meta.camera, 12)
    for frame, picture in zip(range(4), pictures_of(take, video, range(4)), strict=True):
        assert int(np.argmax(picture[0].sum(axis=-1))) == 3 + 2 * frame


def test_nobody_and_a_single_frame(tmp_path):
    for take in (make_take(people=(), frames=3), make_take(frames=1)):
        video = write_video(tmp_path / "clip.avi", take.meta.camera, 3)
        overlay, _ = write_preview(take, video, tmp_path / "out", SilentProgress())
        assert len(frames_of(overlay)) == take.frame_count


def test_another_video_is_refused_and_old_files_stay(tmp_path):
    take = make_take()
    out = tmp_path / "out"
    out.mkdir()
    (out / "overlay.mp4").write_text("old")
    with pytest.raises(VideoError, match="320x240"):
        write_preview(take, write_video(tmp_path / "a.avi", make_camera(160, 120), 12), out, SilentProgress())
    with pytest.raises(VideoError, match=r"ends before.*clip\.avi"):
        write_preview(take, write_video(tmp_path / "b.avi", take.meta.camera, 5), out, SilentProgress())
    assert (out / "overlay.mp4").read_text() == "old"
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(UserError, match="cannot make the directory"):
        write_preview(take, write_video(tmp_path / "c.avi", take.meta.camera, 12), blocked / "out", SilentProgress())


def test_names_that_cannot_be_drawn_are_replaced():
    person = replace(make_take().people[0], name="Zoë")
    assert PosablePerson(person).label.startswith("Person 1")
