"""Which of several maps is believed."""

from dataclasses import replace
from typing import Any

import pytest

from core_solver.errors import UserError

from .skeletons import Build, make_rig
from .test_presets import nameless, renamed_rig, truth_of
from .test_structure import shuffled_names


def find(addon: Any, skeleton: Any, own_map: Any = None) -> Any:
    return addon("retarget.finding").find_map(skeleton, addon("retarget.presets").built_in_presets(), own_map)


def test_the_file_s_own_map_comes_first(addon: Any) -> None:
    truth = truth_of("Mixamo, Ready Player Me")
    skeleton = renamed_rig(addon, truth)
    own = replace(find(addon, skeleton), source="the file's own map")
    assert find(addon, skeleton, own) == own


def test_an_own_map_that_is_not_whole_is_not_believed(addon: Any) -> None:
    skeleton = renamed_rig(addon, truth_of("Mixamo, Ready Player Me"))
    whole = find(addon, skeleton)
    part = replace(whole, bones=tuple(pair for pair in whole.bones if pair[0] != "left_shin"), source="the file")
    gone = replace(
        whole, bones=tuple((r, "gone" if r == "left_shin" else b) for r, b in whole.bones), source="the file"
    )
    assert find(addon, skeleton, part) == whole
    assert find(addon, skeleton, gone) == whole


def test_names_that_lie_are_not_believed(addon: Any) -> None:
    """Names of a known rig on the wrong bones: thigh and shin exchanged, as after a bad renaming."""
    skeleton = renamed_rig(addon, truth_of("Mixamo, Ready Player Me"))
    swap = {"LeftUpLeg": "LeftLeg", "LeftLeg": "LeftUpLeg"}
    lying = replace(skeleton, names=tuple(swap.get(name, name) for name in skeleton.names))
    found = find(addon, lying)
    assert found.source == "structure"
    assert found.bone("left_thigh") == "LeftLeg"


def test_names_without_meaning_leave_the_shape(addon: Any) -> None:
    rig = make_rig(addon, Build(arms_down=0.5))
    anonymous, names = shuffled_names(rig.skeleton)
    found = find(addon, anonymous)
    assert found.source == "structure"
    assert {(role, names[bone]) for role, bone in found.bones} == set(rig.bone_map.bones)


def test_a_known_rig_of_unusable_shape_is_believed_with_less_confidence(addon: Any) -> None:
    skeleton = renamed_rig(addon, truth_of("Mixamo, Ready Player Me"))
    rolled_up = replace(skeleton, heads=skeleton.heads * [1, 1, 0.01])
    found = find(addon, rolled_up)
    assert found.source == "Mixamo, Ready Player Me"
    assert found.confidence < 1


def test_a_known_rig_with_bones_missing_is_given_for_mending(addon: Any) -> None:
    names = tuple(b for r, b in truth_of("Mixamo, Ready Player Me").items() if isinstance(b, str) and "foot" not in r)
    found = find(addon, nameless(addon, names))
    assert found.bone("left_shin") == "LeftLeg"
    assert found.confidence < 0.5


def test_no_humanoid_is_refused(addon: Any) -> None:
    with pytest.raises(UserError, match="legs"):
        find(addon, nameless(addon, ("seat", "back", "wheel")))


def test_a_preset_that_is_asked_for_is_as_sure_as_it_is_whole(addon: Any) -> None:
    skeleton = renamed_rig(addon, truth_of("Mixamo, Ready Player Me"))
    presets = {preset.title: preset for preset in addon("retarget.presets").built_in_presets()}
    by_preset = addon("retarget.finding").map_by_preset
    assert by_preset(skeleton, presets["Mixamo, Ready Player Me"]).confidence == 1
    assert by_preset(skeleton, presets["Blender human metarig"]).confidence < 0.5
