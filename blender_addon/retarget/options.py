# SPDX-License-Identifier: GPL-3.0-or-later
"""How a scene's people are brought onto rigs."""

from dataclasses import dataclass
from typing import Literal

RootPolicy = Literal["root_bone", "hips", "in_place"]
Drive = Literal["fk", "ik"]


@dataclass(frozen=True)
class Options:
    """What the user chose.

    Attributes:
        root: which bone carries a character through the world. "root_bone": the rig's root takes the way over the
            ground and the heading, the hips what is left (rigs without a root: the hips take all); "hips": the hips
            take all and the root rests; "in_place": nobody moves over the ground.
        scale: one factor on the ground for all characters of the scene, so that nobody comes nearer to anybody; 1
            keeps metres.
        feet: put standing feet where the person's stood, by bending the rig's own legs.
        refine: afterwards go over the whole scene for contacts, distances between people and penetration.
        drive: which of a control rig's controls are keyed, where it has both kinds.
    """

    root: RootPolicy = "root_bone"
    scale: float = 1.0
    feet: bool = True
    refine: bool = True
    drive: Drive = "fk"
