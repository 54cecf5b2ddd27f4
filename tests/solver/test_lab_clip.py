"""The real yardstick: two people of a lab clip against their four-view reconstruction. Run with -s for the table.

The truth is for evaluation alone: nothing in the solver may be tuned on it.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from core_solver.body import kinematics
from core_solver.body.skeleton import joint_index
from core_solver.pipeline import SolveOptions, solve_video
from core_solver.progress import SilentProgress
from core_solver.take import Person, Take

pytestmark = [pytest.mark.shared, pytest.mark.models, pytest.mark.slow]


@dataclass(frozen=True)
class Truth:
    """Both people in the camera's frame: hip centres (2, 100, 3) metres and statures (2,)."""

    roots: np.ndarray
    heights: np.ndarray
    gravity: np.ndarray


def read_truth(folder: Path, camera: int) -> Truth:
    archive = np.load(folder / "clips" / "lab_two_people_truth.npz")
    names = list(archive["joint_names"])
    hips = archive["joints"][:, :, [names.index("left_hip"), names.index("right_hip")]].mean(axis=2)
    rotation, translation = archive["R_wc"][camera], archive["t_wc"][camera]
    return Truth(hips @ rotation.T + translation, archive["heights_m"], rotation @ archive["gravity"])


def hip_centre(person: Person) -> np.ndarray:
    _, positions = kinematics.pose_joints(person.theta, person.rest_joints)
    joints = person.scale * positions + person.gamma[:, None]
    return joints[:, [joint_index("left_hip"), joint_index("right_hip")]].mean(axis=1)


def nearest_people(take: Take, truth: Truth) -> list[Person]:
    """Who is who: the man and the woman are those who pass nearest to them on the whole."""
    errors = np.array(
        [[np.linalg.norm(hip_centre(p) - root, axis=1).mean() for p in take.people] for root in truth.roots]
    )
    chosen = errors.argmin(axis=1)
    assert len(set(chosen)) == 2, "one person was taken for both"
    return [take.people[i] for i in chosen]


@pytest.mark.parametrize("depth", ["network", "prior"])
def test_statures_and_places_of_two_people(shared_data: Path, models, tmp_path: Path, depth: str) -> None:
    clips = shared_data / "clips"
    options = SolveOptions(
        video=clips / "lab_two_people_cam01.mp4",
        output=tmp_path / "lab.npz",
        camera=f"{clips / 'lab_two_people_calibration.qca.txt'}:cam01",
        depth=shared_data / "models" if depth == "network" else None,
        models_dir=models.models_dir,
        people=2,
    )
    take = solve_video(options, SilentProgress())
    truth = read_truth(shared_data, camera=0)
    man, woman = nearest_people(take, truth)

    heights = np.array([man.height_m, woman.height_m]) / truth.heights
    roots = np.stack([hip_centre(man), hip_centre(woman)])
    errors = np.linalg.norm(roots - truth.roots, axis=-1).mean(axis=1)
    distance = np.linalg.norm(roots[0] - roots[1], axis=-1).mean()
    true_distance = np.linalg.norm(truth.roots[0] - truth.roots[1], axis=-1).mean()
    lean = np.degrees(np.arccos(np.dot(take.meta.gravity, truth.gravity)))
    print(
        f"\n{depth:8s} heights {heights[0] - 1:+.1%} {heights[1] - 1:+.1%}"
        f"  distance {distance / true_distance - 1:+.1%}"
        f"  root error {errors[0]:.2f} {errors[1]:.2f} m  gravity {lean:.1f} degrees"
    )
    assert np.abs(heights - 1).max() < 0.12
    assert lean < 3
    assert abs(distance / true_distance - 1) < 0.25
    # Feet rest on the ground whenever they are said to.
    for person in (man, woman):
        assert person.valid.all()
        assert person.contacts.max() > 0.5
