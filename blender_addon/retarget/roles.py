# SPDX-License-Identifier: GPL-3.0-or-later
"""The parts of a humanoid that retargeting knows by name."""

SIDES = ("left", "right")
LIMBS = ("clavicle", "upper_arm", "forearm", "hand", "thigh", "shin", "foot", "toe")

ROOT = "root"
"""A bone above the hips that carries the whole character; many rigs have none."""

SPINE = "spine"
"""The only role with several bones: from above the hips to below the neck, in that order."""

TRUNK = ("hips", SPINE, "neck", "head")
ROLES = (ROOT, *TRUNK, *(f"{side}_{limb}" for side in SIDES for limb in LIMBS))
NEEDED = (
    "hips",
    "head",
    *(f"{side}_{limb}" for side in SIDES for limb in ("upper_arm", "forearm", "thigh", "shin", "foot")),
)
"""Without these a rig is no humanoid; the others may be missing."""


def mirrored(role: str) -> str:
    """The same role on the other side; the trunk's are their own."""
    side, _, limb = role.partition("_")
    if side not in SIDES or limb not in LIMBS:
        return role
    return f"{SIDES[1 - SIDES.index(side)]}_{limb}"
