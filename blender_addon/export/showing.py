# SPDX-License-Identifier: GPL-3.0-or-later
"""Show hidden objects for a while."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import bpy

_HIDING = ("hide_viewport", "hide_render")


@contextmanager
def shown(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> Iterator[None]:
    """Inside, the objects are visible, whatever hid them by hand or by a driver; afterwards all is as it was."""
    with ExitStack() as later:
        for obj in objects:
            _show(obj, later)
        context.view_layer.update()
        yield
    context.view_layer.update()


def _show(obj: bpy.types.Object, later: ExitStack) -> None:
    drivers = obj.animation_data.drivers if obj.animation_data else ()
    for driver in [curve for curve in drivers if curve.data_path in _HIDING]:
        later.callback(setattr, driver, "mute", driver.mute)
        driver.mute = True
    for name in _HIDING:
        later.callback(setattr, obj, name, getattr(obj, name))
        setattr(obj, name, False)
    later.callback(obj.hide_set, obj.hide_get())
    obj.hide_set(False)
