"""Distances to a scene's points against a search through all of them."""

from typing import Any

import numpy as np

from .meetings import FRAMES, copied, handshake


def test_distances_are_those_to_the_nearest_point(addon: Any) -> None:
    rng = np.random.default_rng(1)
    wall = np.stack([np.full(4000, 1.0), rng.uniform(-1, 1, 4000), rng.uniform(0, 2, 4000)], axis=1)
    wall += rng.normal(scale=0.003, size=wall.shape)
    places = rng.uniform([0.9, -1, 0], [1.1, 1, 2], (300, 3))
    found = addon("retarget.things").Things.from_points(wall).distance(places)
    true = np.linalg.norm(places[:, None] - wall, axis=2).min(axis=1)
    near = true < 0.03
    assert near.sum() > 30
    # Thinned: the mean of a cell is up to half a cell from its points.
    assert np.abs(found - true)[near].max() < 0.03
    assert np.isinf(found[true > 0.08]).all()


def test_a_hand_on_a_wall_stays_there_on_other_rigs(addon: Any) -> None:
    """Each of two people leans on a wall of his own instead of on the other's hand: the palm stays at its place."""
    actors = handshake(addon, (0.85, 1.2), between=0.4)
    marks = addon("retarget.landmarks")
    ground = addon("retarget.ground").Ground.from_points(_walls())
    refined = addon("retarget.refine").refine(actors, [copied(addon, a) for a in actors], ground)
    for actor, motion in zip(actors, refined, strict=True):
        wanted = marks.palms(actor.source, actor.source_map)[1].positions(actor.motion)
        style = marks.palms(actor.target, actor.target_map)[1].positions(copied(addon, actor))
        found = marks.palms(actor.target, actor.target_map)[1].positions(motion)
        still = slice(FRAMES // 2 - 5, FRAMES // 2 + 5)
        assert np.linalg.norm(style - wanted, axis=1)[still].min() > 0.1
        assert np.linalg.norm(found - wanted, axis=1)[still].max() < 0.01


def _walls() -> np.ndarray:
    """A wall 17 cm to each side of the middle, 3 cm in front of where the palms rest, and the floor."""
    y, z = np.meshgrid(np.arange(-1, 1, 0.02), np.arange(0.5, 2, 0.02))
    walls = [np.stack([np.full(y.size, x), y.ravel(), z.ravel()], axis=1) for x in (-0.17, 0.17)]
    x, y = np.meshgrid(np.arange(-2, 2, 0.04), np.arange(-1, 1, 0.04))
    return np.concatenate([*walls, np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)])
