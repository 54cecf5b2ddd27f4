"""Takes filled with random numbers of any lengths, and what it means that two of them are the same."""

from dataclasses import fields
from fractions import Fraction

import numpy as np
from hypothesis import strategies as st

from core_solver.take import CameraModel, Ground, Meta, Person, Scene, Take


def random_person(rng: np.random.Generator, person_id: int, frames: int, vertices: int, faces: int) -> Person:
    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    weights = rng.uniform(0.1, 1, (vertices, 4))
    return Person(
        id=person_id,
        name=f"Zoë {person_id}",
        height_m=float(rng.uniform(1, 2)),
        colour=(float(rng.uniform()), 0.0, 1.0),
        theta=normal(frames, 24, 3),
        gamma=normal(frames, 3),
        betas=normal(10),
        scale=float(np.float32(rng.uniform(0.5, 1.5))),
        valid=rng.uniform(size=frames) < 0.5,
        confidence=rng.uniform(size=(frames, 24)).astype(np.float32),
        contacts=rng.uniform(size=(frames, 2)).astype(np.float32),
        rest_joints=normal(24, 3),
        rest_vertices=normal(vertices, 3),
        faces=rng.integers(0, max(vertices, 1), (faces if vertices else 0, 3)).astype(np.int32),
        weight_joints=rng.integers(0, 24, (vertices, 4)).astype(np.uint8),
        weights=(weights / weights.sum(axis=1, keepdims=True)).astype(np.float32),
    )


def random_scene(rng: np.random.Generator, frames: int, points: int, depth_size: tuple[int, int]) -> Scene:
    depth = rng.uniform(1, 9, depth_size).astype(np.float32)
    depth[rng.uniform(size=depth_size) < 0.3] = np.nan
    return Scene(
        points=rng.normal(size=(points, 3)).astype(np.float32),
        colors=rng.integers(0, 256, (points, 3)).astype(np.uint8),
        depth=depth,
        z_near=rng.uniform(1, 2, frames).astype(np.float32),
        z_far=rng.uniform(5, 9, frames).astype(np.float32),
    )


def random_meta(rng: np.random.Generator) -> Meta:
    gravity = rng.normal(size=3)
    x, y, z = (float(v) for v in gravity / np.linalg.norm(gravity))
    return Meta(
        frame_rate=Fraction(30000, 1001),
        first_frame=int(rng.integers(0, 100)),
        frame_step=int(rng.integers(1, 5)),
        video_name="Straße \N{CLAPPER BOARD}.mp4",
        camera=CameraModel(1280, 720, 901.5, 900.25, 641.0, 359.5, (-0.1, 0.02, 0.001, -0.002, 0.003), "a test"),
        gravity=(x, y, z),
        ground=Ground((-x, -y, -z), float(rng.uniform(0, 3))),
        body_model="any-body-1",
        body_licence="CC0-1.0",
        depth_source="ground-plane prior",
        preset="fast",
        solver_version="9.8.7",
        settings={"every": 2, "weights": {"joints": 1.0}, "depth": None},
        warnings=("The camera moves by 3 pixels.",),
    )


def random_take(
    seed: int = 0, *, frames: int = 3, people: int = 2, vertices: int = 5, faces: int = 4, points: int = 6,
    depth_size: tuple[int, int] = (2, 3),
) -> Take:  # fmt: skip
    rng = np.random.default_rng(seed)
    crowd = tuple(random_person(rng, 10 * index + 3, frames, vertices, faces) for index in range(people))
    times = 1.5 + np.cumsum(rng.uniform(0.01, 0.1, frames))
    return Take(random_meta(rng), times, crowd, random_scene(rng, frames, points, depth_size))


TAKES = st.builds(
    random_take,
    st.integers(0, 10_000),
    frames=st.integers(1, 6),
    people=st.integers(0, 3),
    vertices=st.integers(0, 6),
    faces=st.integers(0, 5),
    points=st.integers(0, 8),
    depth_size=st.sampled_from([(0, 0), (1, 1), (3, 4)]),
)


def assert_same_array(a: np.ndarray, b: np.ndarray) -> None:
    assert a.dtype == b.dtype
    assert a.shape == b.shape
    assert a.tobytes() == b.tobytes()


def assert_same_take(a: Take, b: Take) -> None:
    """Equal facts, and arrays equal to the last bit."""
    assert a.meta == b.meta
    assert_same_array(a.times, b.times)
    assert len(a.people) == len(b.people)
    for one, other in [(a.scene, b.scene), *zip(a.people, b.people, strict=True)]:
        for name in (f.name for f in fields(one)):
            mine, yours = getattr(one, name), getattr(other, name)
            if isinstance(mine, np.ndarray):
                assert_same_array(mine, yours)
            else:
                assert mine == yours, name
    assert (a.steadying is None) == (b.steadying is None)
    if a.steadying is not None and b.steadying is not None:
        assert_same_array(a.steadying, b.steadying)
    assert list(a.extra) == list(b.extra)
    for key, array in a.extra.items():
        assert_same_array(array, b.extra[key])
