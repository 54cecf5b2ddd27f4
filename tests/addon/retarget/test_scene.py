"""Whole scenes onto rigs of other sizes: the figures that users are shown, and who carries what."""

from typing import Any

import numpy as np
import pytest

from .skeletons import RIGS, make_person, make_rig, walk
from .test_transfer import actor_of, flat, hips_of, options


def two_walkers(addon: Any) -> list[Any]:
    """Two who walk towards each other, side by side: the smaller one gets a rig of 1.4 adults, the other one of 0.7."""
    actors = []
    for size, kind, heading, start in ((0.8, "tall", 0.1, (0.0, 3.0, 0.0)), (1.1, "short", 3.3, (1.2, 0.0, 0.0))):
        person = make_person(addon, size)
        motion, contacts = walk(addon, person, heading=heading, start=start)
        actors.append(actor_of(addon, person, motion, make_rig(addon, RIGS[kind]), contacts))
    return actors


@pytest.mark.parametrize("refine", [False, True])
def test_feet_stand_and_distances_stay_on_rigs_of_other_sizes(addon: Any, refine: bool) -> None:
    actors = two_walkers(addon)
    outcome = addon("retarget.scene").retarget_scene(actors, options(addon, refine=refine), flat(addon))
    assert outcome.people.contact_recall == 1.0
    assert outcome.rigs.contact_recall >= 0.95
    assert outcome.rigs.skate_mm <= 3.0
    assert outcome.rigs.penetration_mm <= 5.0
    assert outcome.rigs.spacing_mm <= 20.0


def test_nobody_swaps_places_in_depth(addon: Any) -> None:
    actors = two_walkers(addon)
    outcome = addon("retarget.scene").retarget_scene(actors, options(addon, refine=False), flat(addon))
    people = [motion_hips(actor.source, actor.motion) for actor in actors]
    rigs = [motion_hips(actor.target, motion) for actor, motion in zip(actors, outcome.motions, strict=True)]
    np.testing.assert_array_equal(people[0] < people[1], rigs[0] < rigs[1])


def motion_hips(skeleton: Any, motion: Any) -> np.ndarray:
    """(T, 2) over the ground, between the hip joints."""
    return motion.heads[:, [skeleton.index(f"{side}_thigh") for side in ("left", "right")], :2].mean(axis=1)


def test_progress_rises_to_one_and_may_end_the_work(addon: Any) -> None:
    actors = two_walkers(addon)
    told: list[float] = []
    addon("retarget.scene").retarget_scene(actors, options(addon), flat(addon), told.append)
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1.0)

    def stop(_: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        addon("retarget.scene").retarget_scene(actors, options(addon), flat(addon), stop)


def test_on_another_floor_everybody_stands_there(addon: Any) -> None:
    """A scene lifted by 3 metres gives rigs lifted by 3 metres."""
    ground = addon("retarget.ground").Ground
    low = two_walkers(addon)
    high = [lifted(addon, actor, 3.0) for actor in low]
    run = addon("retarget.scene").retarget_scene
    chosen = options(addon, refine=False)
    below, above = run(low, chosen, ground.flat(0.0)), run(high, chosen, ground.flat(3.0))
    for one, other in zip(below.motions, above.motions, strict=True):
        np.testing.assert_allclose(
            other.heads - one.heads, np.broadcast_to([0.0, 0.0, 3.0], one.heads.shape), atol=1e-9
        )
    assert above.rigs.contact_recall == pytest.approx(below.rigs.contact_recall)


def lifted(addon: Any, actor: Any, height: float) -> Any:
    motion = addon("retarget.skeleton").Motion(
        actor.motion.times, actor.motion.rotations, actor.motion.heads + np.array([0.0, 0.0, height])
    )
    return type(actor)(
        actor.name, actor.source, actor.source_map, motion, actor.contacts, actor.target, actor.target_map
    )


def test_stairs_are_climbed_without_jolts(addon: Any) -> None:
    """A walker over steps of 0.15 m: soles on the steps, hips of a taller rig as smooth as the person's."""
    person, rig = make_person(addon), make_rig(addon, RIGS["tall"])
    motion, contacts = walk(addon, person)
    rise = np.floor(np.arange(len(motion.times)) / 18) * 0.15
    eased = np.convolve(np.pad(rise, 9, mode="edge"), np.hanning(19) / np.hanning(19).sum(), mode="valid")
    climbing = addon("retarget.skeleton").Motion(
        motion.times, motion.rotations, motion.heads + eased[:, None, None] * [0.0, 0.0, 1.0]
    )
    actor = actor_of(addon, person, climbing, rig, contacts)
    after = addon("retarget.transfer").transfer(actor, options(addon, feet=False), flat(addon))
    theirs, ours = (np.abs(np.diff(hips_of(who, m)[:, 2], n=2)).max() for who, m in ((person, climbing), (rig, after)))
    assert ours < 2.5 * theirs
