"""Write the samples: `python -m tests.samples.make FOLDER`. The same bytes whenever and wherever it runs, but for the
footage, whose bytes are the video encoder's."""

import sys
from pathlib import Path

import cv2
import numpy as np

from core_solver.camera import Camera
from core_solver.preview.bodies import PosablePerson
from core_solver.preview.render import ShownBody, draw_bodies
from core_solver.take import Take, write_take
from tests.samples import people
from tests.samples.rig import write_rig

TAKE, RIG = "sample_take.npz", "sample_rig.glb"
_COATS = 3  # the preview's bodies are translucent; so many one over the other are not


def write_samples(folder: Path) -> None:
    """Take, footage and rig into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    take = people.make_take()
    write_take(folder / TAKE, take)
    (folder / RIG).write_bytes(write_rig())
    _write_footage(take, folder / people.VIDEO)


def _write_footage(take: Take, path: Path) -> None:
    model = people.CAMERA
    camera = Camera(model.width, model.height, model.fx, model.fy, model.cx, model.cy)
    columns, rows = np.meshgrid(np.arange(model.width) + 0.5, np.arange(model.height) + 0.5)
    empty = np.ascontiguousarray(people.see(columns, rows)[2][..., ::-1])
    bodies = [PosablePerson(person) for person in take.people]
    codec = cv2.VideoWriter.fourcc(*"mp4v")
    writer = cv2.VideoWriter(str(path), codec, float(people.RATE), (model.width, model.height))
    for frame in range(take.frame_count):
        shown = [ShownBody(body.vertices(frame), body.person.faces, body.colour) for body in bodies]
        picture = empty
        for _ in range(_COATS):
            picture = draw_bodies(picture, shown, camera)
        writer.write(picture)
    writer.release()


if __name__ == "__main__":
    write_samples(Path(sys.argv[1]))
