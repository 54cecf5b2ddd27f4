"""Two people who shake hands, on rigs of any size: they shake hands there too, where they stood."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from .meetings import FRAMES, REACHING, copied, handshake
from .skeletons import FPS, make_person, walk


@pytest.mark.parametrize("sizes", [(0.7, 0.7), (1.4, 1.4), (0.7, 1.4), (1.4, 0.7)])
def test_hands_meet_on_rigs_of_other_sizes(addon: Any, sizes: tuple[float, float]) -> None:
    actors, refined = refined_handshake(addon, sizes)
    before = [copied(addon, actor) for actor in actors]
    assert palm_gap(addon, actors, before)[REACHING].min() > 0.2
    assert palm_gap(addon, actors, refined)[REACHING].max() < 0.01


@pytest.mark.parametrize("sizes", [(0.7, 1.4), (1.4, 1.4)])
def test_people_stay_where_they_stood(addon: Any, sizes: tuple[float, float]) -> None:
    actors, refined = refined_handshake(addon, sizes)
    measures = addon("retarget.measures").measure_rigs(actors, refined, flat(addon))
    assert measures.spacing_mm < 20
    assert measures.skate_mm < 0.5
    assert measures.penetration_mm < 0.1
    assert measures.touch_mm < 10
    hips = [motion.heads[:, actor.target.index("hips"), 0] for actor, motion in zip(actors, refined, strict=True)]
    assert (hips[0] < hips[1] - 0.5).all()


def test_nothing_changes_where_nobody_touches(addon: Any) -> None:
    actors, refined = refined_handshake(addon, (0.7, 1.4), between=0.4)
    for actor, motion in zip(actors, refined, strict=True):
        np.testing.assert_array_equal(motion.heads, copied(addon, actor).heads)


def test_nobody_bends_for_somebody_who_is_not_there(addon: Any) -> None:
    actors = handshake(addon, (0.7, 1.4))
    gone = np.arange(FRAMES) < REACHING.start - 20
    actors[1] = replace(actors[1], present=gone)
    motions = [copied(addon, actor) for actor in actors]
    for motion, refined in zip(motions, addon("retarget.refine").refine(actors, motions, flat(addon)), strict=True):
        np.testing.assert_array_equal(refined.heads, motion.heads)


def test_far_from_the_touch_the_pose_is_kept_and_it_comes_and_goes_smoothly(addon: Any) -> None:
    actors, refined = refined_handshake(addon, (0.7, 1.4))
    for actor, motion in zip(actors, refined, strict=True):
        style = copied(addon, actor)
        moved = np.linalg.norm(motion.heads - style.heads, axis=2).max(axis=1)
        assert moved[:5].max() < 1e-3
        assert moved[REACHING].min() > 0.1
        # Whatever the body does for the touch is spread over about a third of a second.
        change = motion.heads - style.heads
        assert np.linalg.norm(np.diff(change, axis=0), axis=2).max() * FPS < 4.0
        assert np.linalg.norm(np.diff(change, n=2, axis=0), axis=2).max() * FPS**2 < 45.0


def test_the_same_rig_as_the_person_keeps_its_motion(addon: Any) -> None:
    actors, refined = refined_handshake(addon, (1.0, 1.0))
    for actor, motion in zip(actors, refined, strict=True):
        np.testing.assert_allclose(motion.heads, copied(addon, actor).heads, atol=1e-9)


def test_bodies_do_not_run_into_each_other(addon: Any) -> None:
    """Rigs 1.4 times as large, side by side as close as the people were: arms would pass through each other."""
    actors = walking_pair(addon, 0.52)
    motions = [actor.motion for actor in actors]
    large = [larger(addon, actor) for actor in actors]
    collisions = addon("retarget.collisions")
    styles = [copied_walk(addon, a, m) for a, m in zip(large, motions, strict=True)]
    before = collisions.depth_between(large, styles, of_rigs=True)
    refined = addon("retarget.refine").refine(large, styles, flat(addon))
    after = collisions.depth_between(large, refined, of_rigs=True)
    assert before.max() > 0.03
    assert after.mean() < 0.5 * before.mean()


def test_a_hand_on_another_body_stays_there(addon: Any) -> None:
    """One step aside the first person's palm lies on the second one's forearm; so it does on rigs of other sizes."""
    actors = handshake(addon, (1.2, 0.85))
    actors[1] = moved(addon, actors[1], [-0.2, 0.0, 0.0])
    marks, parts = addon("retarget.landmarks"), addon("retarget.segments")
    touches = [t for t in addon("retarget.touches").find_touches(actors, flat(addon)) if t.role]
    (touch,) = [t for t in touches if (t.actor, t.side, t.other, t.role) == (0, 1, 1, "right_forearm")]
    refined = addon("retarget.refine").refine(actors, [copied(addon, a) for a in actors], flat(addon))
    palm = marks.palms(actors[0].target, actors[0].target_map)[1].positions(refined[0])
    arm = next(p for p in parts.segments(actors[1].target, actors[1].target_map) if p.role == "right_forearm")
    start, end = parts.ends(refined[1], arm)
    along = parts.closest_on_line(start, end, palm)
    gap = np.linalg.norm(palm - start - along[:, None] * (end - start), axis=1) - arm.radius
    # While arms rise and sink, palms pass each other closely too, which draws to another place.
    settled = slice(REACHING.start + 2, REACHING.stop - 2)
    assert (touch.strength[settled] == 1).all()
    assert gap[settled].max() < 0.03


def test_progress_ends_with_all_and_can_cancel(addon: Any) -> None:
    actors = handshake(addon, (0.7, 1.4))
    told: list[float] = []
    addon("retarget.refine").refine(actors, [copied(addon, a) for a in actors], flat(addon), progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0

    def cancel(_: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        addon("retarget.refine").refine(actors, [copied(addon, a) for a in actors], flat(addon), progress=cancel)


@pytest.mark.parametrize(
    ("distance", "held"),
    [
        ([0.2, 0.2, 0.09, 0.13, 0.09, 0.2, 0.2], [0, 0, 1, 1, 1, 0, 0]),
        ([0.2, 0.12, 0.12, 0.12, 0.12, 0.12, 0.2], None),
        ([0.05, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05], [1, 1, 1, 1, 1, 1, 1]),
    ],
)
def test_a_touch_begins_near_and_ends_far(addon: Any, distance: list[float], held: list[int] | None) -> None:
    strength = addon("retarget.touches").strength_of(np.array(distance), np.arange(7.0), 0.1, 0.15)
    assert (strength is None) == (held is None)
    if held is not None:
        np.testing.assert_array_equal(strength == 1, np.array(held, bool))


def refined_handshake(addon: Any, sizes: tuple[float, float], between: float = 0.0) -> tuple[list[Any], Any]:
    actors = handshake(addon, sizes, between)
    motions = [copied(addon, actor) for actor in actors]
    return actors, addon("retarget.refine").refine(actors, motions, flat(addon))


def palm_gap(addon: Any, actors: list[Any], motions: Any) -> np.ndarray:
    palms = addon("retarget.landmarks").palms
    first, second = (
        palms(actor.target, actor.target_map)[1].positions(motion)
        for actor, motion in zip(actors, motions, strict=True)
    )
    return np.linalg.norm(first - second, axis=1)


def walking_pair(addon: Any, apart: float) -> list[Any]:
    person = make_person(addon)
    motion, contacts = walk(addon, person, frames=FRAMES, heading=0.0)
    actor = addon("retarget.actor").Actor(
        "walker", person.skeleton, person.bone_map, motion, contacts, person.skeleton, person.bone_map
    )
    return [actor, moved(addon, actor, [apart, 0.0, 0.0])]


def moved(addon: Any, actor: Any, way: list[float]) -> Any:
    motion = actor.motion
    return replace(actor, motion=addon("retarget.skeleton").Motion(motion.times, motion.rotations, motion.heads + way))


def larger(addon: Any, actor: Any) -> Any:
    rig = make_person(addon, 1.4)
    return replace(actor, target=rig.skeleton, target_map=rig.bone_map)


def copied_walk(addon: Any, actor: Any, motion: Any) -> Any:
    target = actor.target
    shifts = np.zeros(motion.heads.shape)
    hips = target.index("hips")
    shifts[:, hips] = motion.heads[:, hips] * [1, 1, 1.4] - target.heads[hips]
    return addon("retarget.skeleton").place(target, motion.times, motion.rotations, shifts)


def flat(addon: Any) -> Any:
    return addon("retarget.ground").Ground.flat()
