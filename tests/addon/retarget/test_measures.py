"""The table's figures for scenes in which each is known."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from .meetings import copied, handshake
from .skeletons import Rig, make_person, walk


def standing_scene(addon: Any) -> tuple[list[Any], list[Any]]:
    """Two people on rigs like themselves."""
    actors = handshake(addon, (1.0, 1.0))
    return actors, [copied(addon, actor) for actor in actors]


def measured(addon: Any, actors: list[Any], motions: list[Any], **options: Any) -> Any:
    ground = addon("retarget.ground").Ground.flat()
    return addon("retarget.measures").measure_rigs(actors, motions, ground, **options)


def shifted(addon: Any, motion: Any, way: Any) -> Any:
    return addon("retarget.skeleton").Motion(motion.times, motion.rotations, motion.heads + np.asarray(way))


def test_a_perfect_copy_has_no_errors(addon: Any) -> None:
    found = measured(addon, *standing_scene(addon))
    assert found.skate_mm == pytest.approx(0, abs=1e-9)
    assert found.contact_recall == 1
    assert found.spacing_mm == pytest.approx(0, abs=1e-9)
    assert found.touch_mm == pytest.approx(0, abs=1e-9)


def test_one_who_steps_aside_changes_spacing_and_touch(addon: Any) -> None:
    actors, motions = standing_scene(addon)
    found = measured(addon, actors, [shifted(addon, motions[0], [-0.05, 0, 0]), motions[1]])
    assert found.spacing_mm == pytest.approx(50)
    assert found.touch_mm == pytest.approx(50)
    assert found.contact_recall == pytest.approx(0.5)


def test_one_who_sinks_or_floats_loses_contact(addon: Any) -> None:
    actors, motions = standing_scene(addon)
    sunk = measured(addon, actors, [shifted(addon, motions[0], [0, 0, -0.05]), motions[1]])
    assert sunk.penetration_mm == pytest.approx(25)
    assert sunk.contact_recall == pytest.approx(0.5)
    floating = measured(addon, actors, [shifted(addon, motions[0], [0, 0, 0.05]), motions[1]])
    assert floating.penetration_mm == pytest.approx(0, abs=1e-9)
    assert floating.contact_recall == pytest.approx(0.5)


def test_who_glides_while_standing_skates(addon: Any) -> None:
    actors, motions = standing_scene(addon)
    glide = np.arange(len(motions[0].times))[:, None, None] * np.array([0.0, 0.004, 0.0])
    found = measured(addon, actors, [shifted(addon, motions[0], glide), motions[1]])
    assert found.skate_mm == pytest.approx(2.0)


def test_swinging_feet_do_not_skate(addon: Any) -> None:
    rig: Rig = make_person(addon)
    motion, contacts = walk(addon, rig)
    actor = addon("retarget.actor").Actor(
        "walker", rig.skeleton, rig.bone_map, motion, contacts, rig.skeleton, rig.bone_map
    )
    assert measured(addon, [actor], [motion]).skate_mm < 1e-6
    always = replace(actor, contacts=np.ones_like(contacts))
    assert measured(addon, [always], [motion]).skate_mm > 5


def test_bodies_inside_each_other_overlap(addon: Any) -> None:
    actors, motions = standing_scene(addon)
    assert measured(addon, actors, motions).overlap_mm < 60  # palms are together
    apart = motions[0].heads[:1, :1] - motions[1].heads[:1, :1]
    found = measured(addon, actors, [motions[0], shifted(addon, motions[1], apart)])
    radius = addon("retarget.segments").segments(actors[0].target, actors[0].target_map)[0].radius
    assert found.overlap_mm == pytest.approx(2000 * radius, rel=0.02)


def test_a_scene_at_half_its_size_is_measured_at_that_size(addon: Any) -> None:
    actors = handshake(addon, (0.5, 0.5))
    halves = [
        addon("retarget.skeleton").Motion(m.times, m.rotations, m.heads - [0.5, 0.5, 0] * m.heads[:, :1])
        for m in (copied(addon, actor) for actor in actors)
    ]
    found = measured(addon, actors, halves, scale=0.5)
    assert found.spacing_mm < 1e-6
    assert found.contact_recall == 1
