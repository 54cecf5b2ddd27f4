"""How faithful a retargeted scene is: `python -m tests.benchmarks.retarget_quality [--take TAKE] [RIG ...]`.

Needs a Python with bpy and this project. Without arguments the sample take and the sample rig are used. Each rig plays
everybody of the take: at its own size, and as 0.7 and 1.4 times as tall as the people, in turns. Angles are between the
arms and legs of people and rigs, without footprints and ("planted") with them: for footprints the legs of rigs of other
proportions have to bend. "Before" is how far palms that touched are apart without the refinement of the whole scene.
"""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from core_solver.take import read_take

SAMPLES = Path(__file__).resolve().parents[2] / "blender_addon" / "samples"
SIZES = {"own size": None, "0.7 and 1.4": (0.7, 1.4)}
LIMBS = {
    f"{side}_{limb}": f"{side}_{following}"
    for side in ("left", "right")
    for limb, following in (("upper_arm", "forearm"), ("forearm", "hand"), ("thigh", "shin"), ("shin", "foot"))
}
COLUMNS = ("limbs °", "planted °", "skate mm", "sunk mm", "kept %", "spacing mm", "touch mm", "before mm")


def main() -> None:
    """Retarget and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rigs", nargs="*", type=Path, default=[SAMPLES / "sample_rig.glb"], help=".glb or .fbx")
    parser.add_argument("--take", type=Path, default=SAMPLES / "sample_take.npz")
    arguments = parser.parse_args()
    print(f"{arguments.take.name}\n| rig | size | map | " + " | ".join(COLUMNS) + " |")
    for rig in arguments.rigs:
        for label, sizes in SIZES.items():
            source, cells = measured(arguments.take, rig, sizes)
            print(
                f"| {rig.name} | {label} | {source} | "
                + " | ".join("-" if np.isnan(cell) else f"{cell:.1f}" for cell in cells)
                + " |"
            )


def measured(take_file: Path, rig_file: Path, sizes: tuple[float, float] | None) -> tuple[str, list[float]]:
    """The bone map's source and one row of the table."""
    import bpy

    from blender_addon.retarget.bone_map import TAKE_MAP
    from blender_addon.retarget.options import Options
    from blender_addon.rig.maps import map_of
    from blender_addon.rig.retargeting import Role, retarget
    from blender_addon.scene_import.take_import import ImportOptions, import_take

    bpy.ops.wm.read_homefile(use_empty=True)
    take = read_take(take_file)
    people = import_take(bpy.context, take, take_file, ImportOptions(body=False)).armatures
    rigs = [imported_rig(bpy, rig_file) for _ in people]
    if sizes:
        for rig, person, size in zip(rigs, people, np.resize(sizes, len(people)), strict=True):
            rig.scale = np.array(rig.scale) * size * height_of(person) / height_of(rig)
        bpy.context.view_layer.update()
    maps = [map_of(bpy.context, rig, "fk") for rig in rigs]
    roles = [Role(p, TAKE_MAP, rig, rig_map) for p, rig, rig_map in zip(people, rigs, maps, strict=True)]
    retarget(roles, Options(feet=False, refine=False), lambda _: None)
    angle = limb_angle(bpy, roles)
    alone = retarget(roles, Options(refine=False), lambda _: None).outcome.rigs
    planted = limb_angle(bpy, roles)
    rigs_now = retarget(roles, Options(), lambda _: None).outcome.rigs
    cells = [
        angle, planted, rigs_now.skate_mm, rigs_now.penetration_mm, 100 * rigs_now.contact_recall, rigs_now.spacing_mm,
        rigs_now.touch_mm, alone.touch_mm,
    ]  # fmt: skip
    return maps[0].source, cells


def imported_rig(bpy: Any, path: Path) -> Any:
    """The armature in a file, at rest."""
    before = set(bpy.data.objects)
    if path.suffix == ".fbx":
        bpy.ops.import_scene.fbx(filepath=str(path))
    else:
        bpy.ops.import_scene.gltf(filepath=str(path))
    rig = next(obj for obj in bpy.data.objects if obj not in before and obj.type == "ARMATURE")
    if rig.animation_data:
        rig.animation_data_clear()
    return rig


def height_of(obj: Any) -> float:
    """From ankles to head, metres."""
    import bpy

    from blender_addon.retarget.segments import height
    from blender_addon.rig.maps import map_of
    from blender_addon.rig.reading import read_skeleton

    return height(read_skeleton(obj), map_of(bpy.context, obj, "fk"))


def limb_angle(bpy: Any, roles: Sequence[Any]) -> float:
    """Mean angle between people's and rigs' limbs that both have, degrees, as Blender shows the rigs."""
    from blender_addon.rig.reading import read_motion, read_skeleton

    scene = bpy.context.scene
    frames = np.arange(scene.frame_start, scene.frame_end + 1, dtype=float)
    angles = []
    for role in roles:
        bodies = [(role.person, role.person_map), (role.rig, role.rig_map)]
        shown = [(read_skeleton(obj), read_motion(obj, read_skeleton(obj), frames), names) for obj, names in bodies]
        for limb, following in LIMBS.items():
            if role.rig_map.bone(limb) and role.rig_map.bone(following):
                angles.append(between(*(direction(*body, limb, following) for body in shown)))
    return float(np.mean(angles))


def direction(skeleton: Any, motion: Any, bone_map: Any, limb: str, following: str) -> np.ndarray:
    """(T, 3) from one joint to the next."""
    start, end = (skeleton.index(bone_map.needed(role)) for role in (limb, following))
    return motion.heads[:, end] - motion.heads[:, start]


def between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(T,) degrees."""
    across = np.linalg.norm(np.cross(first, second), axis=-1)
    return np.degrees(np.arctan2(across, np.sum(first * second, axis=-1)))


if __name__ == "__main__":
    import blender_addon

    blender_addon.register()
    main()
    sys.stdout.flush()
    # Blender as a module may hang while Python takes it apart.
    os._exit(0)
