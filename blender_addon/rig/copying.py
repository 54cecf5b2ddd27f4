# SPDX-License-Identifier: GPL-3.0-or-later
"""Another character from the same rig: new objects that share its meshes and materials."""

from typing import Any

import bpy


def copy_rig(rig: bpy.types.Object, name: str, *, with_children: bool = True) -> bpy.types.Object:
    """Copy an armature object and all that hangs on it; the rig itself stays as it is.

    Args:
        rig: the armature object.
        name: of the new armature object; its children get it as a suffix of theirs.
        with_children: otherwise the armature alone.

    Returns:
        The new armature object, in the collections of the rig, without its animation.
    """
    copies: dict[bpy.types.Object, bpy.types.Object] = {}
    for original in (rig, *(rig.children_recursive if with_children else ())):
        copy = original.copy()
        copy.name = name if original is rig else f"{original.name} {name}"
        copies[original] = copy
        for collection in original.users_collection:
            collection.objects.link(copy)
    for original, copy in copies.items():
        if original is not rig:
            copy.parent = copies[original.parent]
            copy.matrix_parent_inverse = original.matrix_parent_inverse
        _relink(copy, copies)
    if copies[rig].animation_data is not None:
        copies[rig].animation_data.action = None
    return copies[rig]


def remove_rig(rig: bpy.types.Object) -> None:
    """Take a copy back, with all that hangs on it."""
    for obj in (*rig.children_recursive, rig):
        bpy.data.objects.remove(obj)


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
