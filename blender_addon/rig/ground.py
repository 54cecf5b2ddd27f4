# SPDX-License-Identifier: GPL-3.0-or-later
"""The ground of a Blender scene, out of the clouds that takes brought in."""

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..retarget.ground import Ground
from ..scene_import.point_cloud import MARK

Array = NDArray[np.float64]


def clouds_of(obj: bpy.types.Object) -> list[bpy.types.Object]:
    """The clouds of the take that an armature came with; all of the scene where that take has none."""
    clouds = [cloud for cloud in bpy.context.scene.objects if MARK in cloud and cloud.type == "MESH"]
    return [cloud for cloud in clouds if _take_of(cloud) & _take_of(obj)] or clouds


def cloud_points(obj: bpy.types.Object) -> Array:
    """(P, 3) world, metres: the points of a person's clouds."""
    points = [_points(cloud) for cloud in clouds_of(obj)]
    return np.concatenate(points) if points else np.zeros((0, 3))


def ground_under(obj: bpy.types.Object, soles: Array) -> Ground:
    """The ground that a person of a take stands on.

    Args:
        obj: the person's armature.
        soles: (N, 3) places of the standing soles of all people of the take.
    """
    return Ground.under(cloud_points(obj), soles)


def _take_of(obj: Any) -> set[str]:
    """Names of the collections that hold an object's own ones."""
    own = {collection.name for collection in obj.users_collection}
    return {c.name for c in bpy.data.collections if own & {child.name for child in c.children}}


def _points(cloud: Any) -> Array:
    count = len(cloud.data.vertices)
    local = np.empty(3 * count, np.float32)
    cloud.data.vertices.foreach_get("co", local)
    matrix = np.array(cloud.matrix_world, np.float64)
    return local.reshape(-1, 3).astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
