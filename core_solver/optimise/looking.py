"""Looking at the picture again from where the bodies now stand: what they cover, where their feet rest."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from core_solver.camera import Camera
from core_solver.optimise.evidence import Evidence
from core_solver.optimise.joint_energy import JointEnergy
from core_solver.optimise.picture_terms import DepthTerms, PictureTerms
from core_solver.optimise.raster_evidence import Grids, find_contours, no_depth, pixel_depth, read_grids, vertex_depth
from core_solver.optimise.variables import Variables
from core_solver.scene.contacts import contact_probability
from core_solver.scene.support import Support
from core_solver.tracking.tracks import Modalities

Array = NDArray[np.float64]


_DEPTH_LIVES = 3  # looks


@dataclass(frozen=True)
class Look:
    """How closely to look at the picture.

    Attributes:
        long_side: pixels of the raster grid's longer side.
        samples: of each outline.
        each_pixel: mean depths over all pixels instead of over the proxy's visible vertices.
    """

    long_side: int
    samples: int
    each_pixel: bool


class Onlooker:
    """Renews what an energy has linearised."""

    def __init__(self, modalities: Modalities, camera: Camera, evidence: Evidence, still: Array, levels: Array) -> None:
        """Keep what looking needs besides the bodies.

        Args:
            modalities: masks and disparity.
            camera: intrinsics.
            evidence: tracks in solver units.
            still: (N, T, 2) probability that a foot rests in the picture.
            levels: (N,) metres by which each person's own floor lies above the common ground.
        """
        self._modalities, self._camera, self._evidence = modalities, camera, evidence
        self._still = still
        self._levels = np.broadcast_to(levels[:, None, None], still.shape)
        self._support: Support | None = None
        self._grids: dict[int, Grids] = {}
        self._depth: DepthTerms | None = None
        self._looks = 0

    def look(self, energy: JointEnergy, v: Variables, closely: Look) -> None:
        """Renew the raster terms, the contacts, the supports and everybody's spheres."""
        self.look_at_feet(energy, v)
        with torch.no_grad():
            spheres = [energy.spheres(v, n, energy.posed(v, n)) for n in range(energy.people)]
        energy.look(spheres=torch.cat(spheres), picture=self._picture(energy, v, closely))

    def stand_on(self, support: Support | None) -> None:
        """Let feet stand on the scene's surface from now on."""
        self._support = support

    def look_at_feet(self, energy: JointEnergy, v: Variables) -> None:
        """Renew contacts and supports."""
        support = self.support(energy, v)
        heights, distance = foot_heights(energy, v)
        contacts = contact_probability(heights - support, self._still, distance) * self._evidence.valid[..., None]
        like = v.theta
        energy.look(
            contacts=torch.as_tensor(contacts, dtype=like.dtype, device=like.device),
            support=torch.as_tensor(support.copy(), dtype=like.dtype, device=like.device),
        )

    def support(self, energy: JointEnergy, v: Variables) -> Array:
        """(N, T, 2) metres by which what carries each foot lies above the common ground."""
        if self._support is None:
            return self._levels
        soles = lowest_soles(energy, v)
        heights, trust = self._support.heights_under(soles)
        above = heights - self._support.plane_under(soles)
        return np.where(trust > 0, trust * above + (1 - trust) * self._levels, self._levels)

    def _picture(self, energy: JointEnergy, v: Variables, closely: Look) -> PictureTerms:
        w = energy.weights
        if closely.long_side not in self._grids:
            self._grids[closely.long_side] = read_grids(self._modalities, self._camera, closely.long_side)
        grids, ids = self._grids[closely.long_side], [track.id for track in self._modalities.tracks]
        contours = find_contours(energy, v, grids, ids, closely.samples) if w.silhouette > 0 else None
        # Depths change little while outlines settle: one look serves for a few iterations.
        if self._depth is None or closely.each_pixel or self._looks % _DEPTH_LIVES == 0:
            self._depth = self._look_at_depth(energy, v, grids, ids, closely)
        self._looks += 1
        return PictureTerms(self._depth, contours)

    def _look_at_depth(
        self, energy: JointEnergy, v: Variables, grids: Grids, ids: list[int], closely: Look
    ) -> DepthTerms:
        if self._modalities.disparity is None or energy.weights.depth == 0:
            return no_depth(v)
        if closely.each_pixel:
            return pixel_depth(energy, v, grids, ids)
        return vertex_depth(energy, v, self._evidence, self._modalities, self._camera)


def foot_heights(energy: JointEnergy, v: Variables) -> tuple[Array, Array]:
    """Height of each foot's lowest point above the common ground (N, T, 2) and people's distance (N, T), metres."""
    with torch.no_grad():
        heights = torch.cat([energy.sole_heights(v, n, energy.posed(v, n)) for n in range(energy.people)])
        distance = torch.exp(v.log_scale)[:, None] * v.translation[..., 2]
    return heights.amin(-1).cpu().double().numpy(), distance.cpu().double().numpy()


def lowest_soles(energy: JointEnergy, v: Variables) -> Array:
    """(N, T, 2, 3) metres, camera frame: the lowest sole point of each foot."""
    with torch.no_grad():
        up = energy.up(v)
        people = []
        for n in range(energy.people):
            posed, one = energy.posed(v, n), slice(n, n + 1)
            soles = (posed.skin(energy.body.soles, v.betas[one]) + v.translation[one, :, None]).unflatten(2, (2, -1))
            lowest = (soles @ up).argmin(-1)[..., None, None].expand(*soles.shape[:3], 1, 3)
            people.append(torch.exp(v.log_scale[n]) * torch.gather(soles, 3, lowest)[..., 0, :])
    return torch.cat(people).cpu().double().numpy()
