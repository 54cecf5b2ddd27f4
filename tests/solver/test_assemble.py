"""A solution becomes a take that says the same, in the file's types."""

import dataclasses
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from core_solver.assemble import PALETTE, Provenance, _four_weights, assemble_take
from core_solver.body import BodyModel
from core_solver.camera import camera_from_fov
from core_solver.geometry import GroundFrame
from core_solver.optimise.solution import Solution
from core_solver.take import Scene, Take, read_take, write_take
from core_solver.take.validation import check_take
from core_solver.tracking.tracks import Modalities, Track
from core_solver.video import VideoClip
from tests.solver.body.synthetic import make_stick_body

BODY = make_stick_body()
FRAMES = 5


def make_track(track_id: int) -> Track:
    valid = np.arange(FRAMES) % 2 == track_id % 2
    zeros = np.zeros((FRAMES, 25), np.float32)
    return Track(
        track_id, valid, np.zeros((FRAMES, 25, 2), np.float32), zeros, np.zeros((FRAMES, 25, 3), np.float32), 0.9
    )


def make_solution(people: int) -> Solution:
    rng = np.random.default_rng(people)
    return Solution(
        theta=rng.normal(size=(people, FRAMES, 24, 3)),
        gamma=rng.normal(size=(people, FRAMES, 3)),
        betas=rng.normal(size=(people, 10)),
        scales=rng.uniform(0.7, 1.3, people),
        confidence=rng.uniform(size=(people, FRAMES, 24)),
        contacts=rng.uniform(size=(people, FRAMES, 2)),
        inverse_far=np.full(FRAMES, 0.1),
        inverse_gap=np.full(FRAMES, 0.4),
        # Optimisers leave directions nearly but not exactly of unit length.
        ground=GroundFrame(np.array([0.0, 1.002, 0.0]), np.array([0.0, -0.998, 0.0]), 1.7),
    )


def assemble(people: int = 2, body: BodyModel = BODY, every: int = 3) -> tuple[Take, Solution, Modalities]:
    frames = 30 + every * np.arange(FRAMES)
    tracks = tuple(make_track(7 * index + 1) for index in range(people))
    modalities = Modalities(frames / 25, frames, (640, 480), tracks, np.zeros((FRAMES, 2, 2), np.uint8), None)
    clip = VideoClip(Path("folder/clip.mp4"), 640, 480, Fraction(25), is_variable=False, every=every, frame_list=())
    z = np.ones(FRAMES, np.float32)
    scene = Scene(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8), np.zeros((0, 0), np.float32), z, 2 * z)
    provenance = Provenance("a network", "default", {"seed": 1}, ("Look out.",))
    solution = make_solution(people)
    camera = camera_from_fov(640, 480, 60, "a guess")
    return assemble_take(modalities, solution, camera, body, clip, scene, provenance), solution, modalities


@pytest.mark.parametrize("people", [0, 1, 3])
def test_the_take_is_whole_and_comes_back_from_disk(tmp_path: Path, people: int) -> None:
    take, _, _ = assemble(people)
    check_take(take)
    write_take(tmp_path / "take.npz", take)
    back = read_take(tmp_path / "take.npz")
    assert back.meta == take.meta
    assert [p.id for p in back.people] == [7 * index + 1 for index in range(people)]


def test_everybody_gets_their_own_part_of_the_solution() -> None:
    take, solution, modalities = assemble(3)
    for index, person in enumerate(take.people):
        for name in ("theta", "gamma", "betas", "confidence", "contacts"):
            np.testing.assert_array_equal(getattr(person, name), getattr(solution, name)[index].astype(np.float32))
        assert person.scale == solution.scales[index]
        np.testing.assert_array_equal(person.valid, modalities.tracks[index].valid)
        assert person.valid is not modalities.tracks[index].valid
        np.testing.assert_allclose(person.rest_joints, BODY.rest_joints(solution.betas[index]), atol=1e-6)
        np.testing.assert_allclose(person.rest_vertices, BODY.rest_vertices(solution.betas[index]), atol=1e-6)
        assert person.name == f"Person {person.id}"


def test_heights_are_of_the_scaled_body() -> None:
    take, solution, _ = assemble(3)
    for person, scale in zip(take.people, solution.scales, strict=True):
        # The rest pose stands upright: y from the soles to the crown, before the scale.
        assert person.height_m == pytest.approx(scale * np.ptp(person.rest_vertices[:, 1]), abs=1e-4)
    assert len({person.height_m for person in take.people}) == 3


def test_meta_tells_the_takes_own_clock_and_video() -> None:
    take, _, _ = assemble(every=3)
    assert (take.meta.first_frame, take.meta.frame_step) == (30, 3)
    assert take.meta.frame_rate == Fraction(25, 3)
    np.testing.assert_allclose(np.diff(take.times), float(1 / take.meta.frame_rate))
    assert take.meta.video_name == "clip.mp4"
    assert (take.meta.body_model, take.meta.body_licence) == (BODY.id, BODY.licence)
    assert take.meta.camera.source == "a guess"
    assert (take.meta.depth_source, take.meta.preset, take.meta.warnings) == ("a network", "default", ("Look out.",))


def test_directions_are_made_unit_vectors_of_the_same_plane() -> None:
    take, solution, _ = assemble()
    meta = take.meta
    on_ground = [3.0, 1.7 / 0.998, 8.0]
    assert solution.ground.height_above(on_ground) == pytest.approx(0, abs=1e-12)
    assert np.dot(meta.ground.normal, on_ground) + meta.ground.offset == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(meta.gravity, [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(meta.ground.normal, [0, -1, 0], atol=1e-12)


def test_colours_differ_in_a_crowd() -> None:
    people = assemble(3 * len(PALETTE))[0].people
    assert len({person.colour for person in people}) == 3 * len(PALETTE)
    assert [person.colour for person in people[: len(PALETTE)]] == list(PALETTE)


@given(hnp.arrays(float, (6, 24), elements=st.floats(0, 1)))
def test_four_weights_are_the_strongest_and_sum_to_one(weights: np.ndarray) -> None:
    weights = weights + np.eye(6, 24)  # every vertex hangs on something
    weights /= weights.sum(axis=1, keepdims=True)
    joints, kept = _four_weights(weights)
    assert (joints.dtype, kept.dtype, joints.shape, kept.shape) == (np.uint8, np.float32, (6, 4), (6, 4))
    np.testing.assert_allclose(kept.sum(axis=1), 1, atol=1e-6)
    for row, chosen, share in zip(weights, joints, kept, strict=True):
        assert len(set(chosen.tolist())) == 4
        assert np.delete(row, chosen).max() <= row[chosen].min()
        np.testing.assert_allclose(share, row[chosen] / row[chosen].sum(), atol=1e-6)


def test_a_body_with_many_joints_a_vertex_still_makes_a_take() -> None:
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.full(24, 0.3), len(BODY.weights))
    take, _, _ = assemble(1, dataclasses.replace(BODY, weights=weights))
    check_take(take)
    np.testing.assert_array_equal(take.people[0].weight_joints[:, 0], weights.argmax(axis=1))
