# SPDX-License-Identifier: GPL-3.0-or-later
"""Another character from the same rig: new objects that share its meshes and materials."""

from collections.abc import Iterator
from typing import Any

import bpy


def copy_rig(rig: bpy.types.Object, name: str, *, with_children: bool = True) -> bpy.types.Object:
    """Copy an armature object and all that hangs on it; the rig itself stays as it is.

    Args:
        rig: the armature object.
        name: of the new armature object; its children get it as a suffix of theirs.
        with_children: otherwise the armature alone.

    Returns:
        The new armature object, at rest and without the rig's animation; in the collections of the rig, or in the
        scene's own where those cannot be edited or are not shown.
    """
    hidden = _hidden_homes(rig)
    copies: dict[bpy.types.Object, bpy.types.Object] = {}
    try:
        for original in (rig, *(rig.children_recursive if with_children else ())):
            copy = copies[original] = original.copy()
            if copy.override_library is not None:
                copy.make_local()
            copy.name = name if original is rig else f"{original.name} {name}"
            for collection in _homes(original, hidden):
                collection.objects.link(copy)
        _hang(rig, copies)
    except BaseException:
        for copy in copies.values():
            bpy.data.objects.remove(copy)
        raise
    return copies[rig]


def remove_rig(rig: bpy.types.Object) -> None:
    """Take a copy back, with all that hangs on it."""
    for obj in (*rig.children_recursive, rig):
        bpy.data.objects.remove(obj)


def _hang(rig: bpy.types.Object, copies: dict[bpy.types.Object, bpy.types.Object]) -> None:
    """Let the copies hang on and follow each other, and be at rest."""
    for original, copy in copies.items():
        if original is not rig:
            copy.parent = copies[original.parent]
            copy.matrix_parent_inverse = original.matrix_parent_inverse
        _relink(copy, copies)
    _still(copies[rig])


def _hidden_homes(rig: Any) -> set[bpy.types.Collection]:
    """The rig's collections, when none of them is shown."""
    shown = {layer.collection for layer in _layers(bpy.context.view_layer.layer_collection) if layer.is_visible}
    homes = set(rig.users_collection)
    return set() if homes & shown else homes


def _layers(layer: Any) -> Iterator[Any]:
    yield layer
    for child in layer.children:
        if not child.exclude:
            yield from _layers(child)


def _homes(original: Any, hidden: set[bpy.types.Collection]) -> set[bpy.types.Collection]:
    """Where a copy goes: to its original's collections, or to the scene's own instead."""
    return {
        bpy.context.scene.collection if home in hidden or home.library or home.override_library else home
        for home in original.users_collection
    }


def _still(copy: Any) -> None:
    """Take away the motion and the pose; drivers stay, they belong to the rig."""
    animation = copy.animation_data
    if animation is not None:
        animation.action = None
        for track in list(animation.nla_tracks):
            animation.nla_tracks.remove(track)
    for bone in copy.pose.bones:
        bone.matrix_basis.identity()


def _relink(copy: Any, copies: dict[bpy.types.Object, bpy.types.Object]) -> None:
    """Let modifiers, constraints and drivers of a copy follow the copies instead of the originals."""
    owners = [*copy.modifiers, *copy.constraints]
    if copy.pose is not None:
        owners += [constraint for bone in copy.pose.bones for constraint in bone.constraints]
    owners += [target for owner in owners for target in getattr(owner, "targets", ())]
    for owner in owners:
        for prop in owner.bl_rna.properties:
            if prop.type == "POINTER" and not prop.is_readonly and getattr(owner, prop.identifier) in copies:
                setattr(owner, prop.identifier, copies[getattr(owner, prop.identifier)])
    drivers = copy.animation_data.drivers if copy.animation_data else ()
    for target in (t for driver in drivers for variable in driver.driver.variables for t in variable.targets):
        if target.id in copies:
            target.id = copies[target.id]
