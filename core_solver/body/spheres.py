"""A body as two dozen spheres along its bones: enough to notice when people or limbs pass through each other."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.body.model import BodyModel
from core_solver.body.skeleton import joint_index

Array = NDArray[np.float64]

# From joint to joint, how many spheres on the way, and the part of the body they belong to.
_BONES = (
    ("pelvis", "spine1", 1, "trunk"), ("spine2", "spine3", 1, "trunk"), ("spine3", "neck", 1, "trunk"),
    ("neck", "head", 1, "head"),
    *((f"{side}_{start}", f"{side}_{end}", count, f"{side}_{part}")
      for side in ("left", "right")
      for start, end, count, part in (("hip", "knee", 3, "leg"), ("knee", "ankle", 3, "leg"),
                                      ("shoulder", "elbow", 2, "arm"), ("elbow", "wrist", 2, "arm"),
                                      ("wrist", "hand", 1, "arm"))),
)  # fmt: skip
_SMALLEST_M = 0.02


@dataclass(frozen=True)
class Spheres:
    """M spheres; each moves with the joint its bone begins at.

    Attributes:
        template: (M, 3) centres at betas = 0, metres.
        directions: (M, 3, 10) metres per unit of beta.
        weights: (M, 24) one joint each.
        radii: (M,) metres, of a neutral body.
        pairs: (Q, 2) spheres of one body that must not meet: an arm and the trunk, the head or a leg, and two legs.
    """

    template: Array
    directions: Array
    weights: Array
    radii: Array
    pairs: NDArray[np.int64]


def body_spheres(body: BodyModel) -> Spheres:
    """Spheres inside a body's skin, as wide as the skin is on average around their bones."""
    rest, joints = body.rest_vertices(body.neutral_betas), body.rest_joints(body.neutral_betas)
    templates, directions, carriers, radii, parts = [], [], [], [], []
    for start, end, count, part in _BONES:
        a, b = joint_index(start), joint_index(end)
        skin = rest[body.weights[:, a] > 0.5]
        radius = _bone_radius(skin, joints[a], joints[b])
        for share in (np.arange(count) + 0.5) / count:
            templates.append((1 - share) * body.joint_template[a] + share * body.joint_template[b])
            directions.append((1 - share) * body.joint_directions[a] + share * body.joint_directions[b])
            carriers.append(np.eye(24)[a])
            radii.append(radius)
            parts.append(part)
    sphere_radii = np.array(radii)
    centres = np.stack(templates) + np.stack(directions) @ body.neutral_betas
    pairs = _self_pairs(parts)
    apart = np.linalg.norm(centres[pairs[:, 0]] - centres[pairs[:, 1]], axis=1)
    # What touches at rest, thick thighs for instance, is no collision.
    free = apart > sphere_radii[pairs].sum(axis=1)
    return Spheres(np.stack(templates), np.stack(directions), np.stack(carriers), sphere_radii, pairs[free])


def _bone_radius(skin: Array, start: Array, end: Array) -> float:
    """A quarter of the skin lies closer to the bone than this: spheres stay inside flat parts too."""
    if len(skin) == 0:
        return _SMALLEST_M
    bone = end - start
    along = np.clip((skin - start) @ bone / max(float(bone @ bone), 1e-9), 0, 1)
    distance = np.linalg.norm(skin - start - along[:, None] * bone, axis=1)
    return max(float(np.quantile(distance, 0.25)), _SMALLEST_M)


def _self_pairs(parts: list[str]) -> NDArray[np.int64]:
    """Pairs of parts that really collide; an upper arm belongs beside the trunk."""
    upper = {i for i, part in enumerate(parts) if part.endswith("arm") and parts.index(part) + 2 > i}
    pairs = []
    for i in range(len(parts)):
        for j in range(i + 1, len(parts)):
            kinds = {parts[i].split("_")[-1], parts[j].split("_")[-1]}
            legs = kinds == {"leg"} and parts[i] != parts[j]
            arms = "arm" in kinds and parts[i] != parts[j] and not {i, j} & upper
            if legs or arms:
                pairs.append((i, j))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)
