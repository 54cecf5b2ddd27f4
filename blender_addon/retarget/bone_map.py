# SPDX-License-Identifier: GPL-3.0-or-later
"""Which bone of a rig plays which part of a humanoid."""

from dataclasses import dataclass, field

from .roles import SPINE


@dataclass(frozen=True)
class BoneMap:
    """Roles and bones of one rig.

    Attributes:
        bones: (role, bone name) pairs; every role at most once, except the spine, whose bones stand in order from the
            hips upwards.
        source: where it comes from, to be shown: a preset's title, "the file's own map", "structure", "edited".
        confidence: 0..1 for the whole map.
        doubts: roles that were found with less confidence than the map as a whole, each with its own 0..1.
    """

    bones: tuple[tuple[str, str], ...]
    source: str = "edited"
    confidence: float = 1.0
    doubts: dict[str, float] = field(default_factory=dict)

    def bone(self, role: str) -> str | None:
        """The bone of a role, the lowest one for the spine; None when the rig has none."""
        return next((name for key, name in self.bones if key == role), None)

    def needed(self, role: str) -> str:
        """The bone of a role that the rig must have; raises ValueError when it has none."""
        name = self.bone(role)
        if name is None:
            raise ValueError(f"a humanoid needs a bone for {role}")
        return name

    @property
    def spine(self) -> tuple[str, ...]:
        """The spine's bones from the hips upwards."""
        return tuple(name for key, name in self.bones if key == SPINE)

    def role_of(self, bone: str) -> str | None:
        """The role that a bone plays; None for all others."""
        return next((key for key, name in self.bones if name == bone), None)


_LIMB_OF_JOINT = {
    "collar": "clavicle", "shoulder": "upper_arm", "elbow": "forearm", "wrist": "hand",
    "hip": "thigh", "knee": "shin", "ankle": "foot", "foot": "toe",
}  # fmt: skip

TAKE_MAP = BoneMap(
    bones=(
        ("hips", "pelvis"),
        *((SPINE, f"spine{number}") for number in (1, 2, 3)),
        ("neck", "neck"),
        ("head", "head"),
        *(
            (f"{side}_{limb}", f"{side}_{joint}")
            for side in ("left", "right")
            for joint, limb in _LIMB_OF_JOINT.items()
        ),
    ),
    source="take",
)
"""The armatures that a take brings in: their bones are named after the joints they begin at."""
