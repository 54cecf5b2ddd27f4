"""What feet can stand on: the walkable surface of the scene under any point, and how far it can be trusted."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from core_solver.camera import Camera
from core_solver.geometry import GroundFrame
from core_solver.scene.normals import depth_normals, grid_points
from core_solver.scene.thinning import voxel_representatives

Array = NDArray[np.float64]

_STEEPEST_COSINE = np.cos(np.radians(35))  # nobody stands on what is steeper
_VOXEL_M = 0.04
_NEIGHBOURS = 32  # on a floor seen in full they lie within 13 cm; around a foot that hides its floor, farther out
_REACH_M = 0.25
_REACH_PER_M = 0.02  # far floors are seen in rows farther apart
_STEP_UP_M = 0.3  # what is higher above the point is not under it
_BESIDE_M = 0.1
_UPPER_SHARE = 0.65  # of two levels the upper one is it when it makes up more than a third of what is near
_LAYER_M = 0.08  # within which points belong to one surface
_SLOPE_SIGMA = 0.3
_POINT_SIGMA_M = 0.02
_ROUGH_M = 0.03  # points so far from their common plane halve the trust
_SLANTED = 0.35  # a slope that halves it: ramps are gentler, waves of a poor depth network steeper
_ROUNDS = 4
_ENOUGH = 3.0  # neighbours' weight for full trust
_HEARD = 0.1  # trust below which the surface says nothing about a sole
_FEWEST_SOLES = 4
_SOLE_SIGMA_M = 0.05  # how well soles are found


@dataclass(frozen=True)
class Support:
    """The walkable surface of a static scene; heights are `up . x` in metres, from the camera.

    Attributes:
        ground: gravity, and the plane where the scene shows no surface.
        plan: (M, 2) horizontal places of walkable points, metres.
        heights: (M,) of these points.
        axes: (3, 2) horizontal unit vectors, which turn points into places.
        tree: of `plan`.
        lift: metres added to the surface, see `calibrated`.
        trust: in [0, 1], of the whole surface.
    """

    ground: GroundFrame
    plan: Array
    heights: Array
    axes: Array
    tree: KDTree
    lift: float = 0.0
    trust: float = 1.0

    @property
    def up(self) -> Array:
        """(3,) against gravity."""
        return -np.asarray(self.ground.gravity, float)

    def heights_under(self, points: Array) -> tuple[Array, Array]:
        """The walkable surface at or below points.

        Args:
            points: (..., 3) metres, camera frame.

        Returns:
            height (...) of the surface and trust (...) in [0, 1]. Where no surface is near, the trust is 0 and the
            height that of the ground plane; a point that is not finite gets the plane's height below the camera.
        """
        flat = np.asarray(points, float).reshape(-1, 3)
        finite = np.asarray(np.isfinite(flat).all(axis=1))
        flat = np.where(finite[:, None], flat, 0.0)
        height, trust = self.plane_under(flat), np.zeros(len(flat))
        if len(self.plan) and len(flat):
            surface, certain = self._surface(flat)
            height = np.where(certain > 0, surface + self.lift, height)
            trust = self.trust * certain * finite
        shape = np.shape(points)[:-1]
        return height.reshape(shape), trust.reshape(shape)

    def floor_under(self, points: Array) -> Array:
        """Heights (...) of what lies below (..., 3) points: the surface as far as it is trusted, else the plane."""
        height, trust = self.heights_under(points)
        return trust * height + (1 - trust) * self.plane_under(np.nan_to_num(points))

    def plane_under(self, points: Array) -> Array:
        """Heights (...) of the ground plane on the verticals through (..., 3) points."""
        points, normal = np.asarray(points, float), self.ground.normal
        return points @ self.up - (points @ normal + self.ground.offset) / (normal @ self.up)

    def calibrated(self, soles: Array, rests: Array) -> "Support":
        """The surface moved to the soles that rest on it, and trusted as far as they agree about it.

        Networks bend floors: then resting soles lie now above and now below the surface, by more than they lie about
        the ground plane. On stairs it is the other way round. A raised foot may be still too, so it is the middle of
        the soles that lifts the surface, and the quarter farthest off is not asked.

        Args:
            soles: (..., 3) metres, lowest points of feet.
            rests: (...) probability that the foot rests in the picture, whatever its height.
        """
        still = np.asarray(soles)[np.asarray(rests) > 0.5]
        height, trust = self.heights_under(still)
        still, height = still[trust > _HEARD], height[trust > _HEARD]
        if len(still) < _FEWEST_SOLES:
            return self
        middle, spread = _middle_and_spread(still @ self.up - height)
        # About a plane people may stand on several levels: there it is not the middle that counts.
        plane = np.quantile(np.abs(still @ self.up - self.plane_under(still)), 0.75)
        known = _SOLE_SIGMA_M**2 + float(plane) ** 2
        return replace(self, lift=self.lift + middle, trust=self.trust * known / (known + spread**2))

    def _surface(self, points: Array) -> tuple[Array, Array]:
        """Height (Q,) and trust (Q,) from the nearest walkable points; an upward plane through the uppermost layer."""
        count = min(_NEIGHBOURS, len(self.plan))
        distance, index = self.tree.query(points @ self.axes, k=np.arange(1, count + 1))
        offset = self.plan[index] - (points @ self.axes)[:, None]
        height = self.heights[index]
        reach = np.maximum(_REACH_M, _REACH_PER_M * np.linalg.norm(points, axis=1))[:, None]
        above = height - (points @ self.up)[:, None]
        # The next stair is beside a foot and not under it.
        usable = (distance < reach) & (above < np.where(distance < _BESIDE_M, _STEP_UP_M, _LAYER_M))
        width = np.clip(distance[:, min(8, count) - 1, None], 0.06, reach / 2)
        weight = np.exp(-0.5 * (distance / width) ** 2) * usable
        # Around a hidden floor all are far off: what is nearest counts fully all the same.
        weight = weight / np.maximum(weight.max(axis=1, keepdims=True), 1e-300)
        start = _weighted_quantile(height, weight, _UPPER_SHARE)
        plane, rough, mass = _upper_plane(offset, height, weight, start)
        gap = np.min(np.where(usable, distance, np.inf), axis=1)
        near = np.clip(2 * (1 - gap / reach[:, 0]), 0, 1)
        slant = np.hypot(plane[:, 1], plane[:, 2])
        trust = near * np.minimum(mass / _ENOUGH, 1) / (1 + (rough / _ROUGH_M) ** 2) / (1 + (slant / _SLANTED) ** 4)
        return plane[:, 0], np.where(usable.any(axis=1), trust, 0.0)


def build_support(depth: NDArray[np.float32], camera: Camera, ground: GroundFrame) -> Support:
    """The walkable surface of a static depth map.

    Args:
        depth: (h, w) metres laid over the whole image, NaN where unknown.
        camera: intrinsics.
        ground: gravity and ground plane.
    """
    points = grid_points(depth, camera)
    return support_from_points(points.reshape(-1, 3), depth_normals(points).reshape(-1, 3), ground)


def support_from_points(points: Array, normals: Array, ground: GroundFrame) -> Support:
    """The walkable surface among (P, 3) points with their (P, 3) unit normals; those with NaN are left out."""
    up = -np.asarray(ground.gravity, float)
    side = np.cross(up, [0.0, 0.0, 1.0] if abs(up[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    axes = np.stack([side, np.cross(up, side)], axis=1)
    with np.errstate(invalid="ignore"):
        walkable = points[(normals @ up > _STEEPEST_COSINE) & np.isfinite(points).all(axis=1)]
    if len(walkable):
        walkable = walkable[voxel_representatives(walkable, _VOXEL_M)]
    plan = walkable @ axes
    return Support(ground, plan, walkable @ up, axes, KDTree(plan))


def _middle_and_spread(values: Array) -> tuple[float, float]:
    """Median, and by how much three quarters of the values differ from it at most."""
    middle = float(np.median(values))
    return middle, float(np.quantile(np.abs(values - middle), 0.75))


def _weighted_quantile(values: Array, weights: Array, share: float) -> Array:
    """(Q,) of (Q, K)."""
    order = np.argsort(values, axis=1)
    total = np.cumsum(np.take_along_axis(weights, order, axis=1), axis=1)
    place = (total < share * total[:, -1:]).sum(axis=1, keepdims=True).clip(0, values.shape[1] - 1)
    return np.take_along_axis(values, np.take_along_axis(order, place, axis=1), axis=1)[:, 0]


def _upper_plane(offset: Array, height: Array, weight: Array, start: Array) -> tuple[Array, Array, Array]:
    """Robust planes height = a + b x + c y about levels to start from.

    Args:
        offset: (Q, K, 2) from the point sought.
        height: (Q, K).
        weight: (Q, K).
        start: (Q,) heights.

    Returns:
        (Q, 3) a, b, c; roughness (Q,) in metres; weight (Q,) of the points that belong to the plane.
    """
    design = np.concatenate([np.ones((*height.shape, 1)), offset], axis=-1)
    ridge = np.diag([1e-9, 1.0, 1.0]) * (_POINT_SIGMA_M / _SLOPE_SIGMA) ** 2
    plane = np.stack([start, np.zeros_like(start), np.zeros_like(start)], axis=-1)
    belongs = residual = np.zeros_like(height)
    for _ in range(_ROUNDS):
        residual = height - np.einsum("qki,qi->qk", design, plane)
        belongs = weight * np.maximum(1 - (residual / _LAYER_M) ** 2, 0) ** 2
        weighted = design * belongs[..., None]
        square = np.einsum("qki,qkj->qij", weighted, design) + ridge
        plane = np.linalg.solve(square, np.einsum("qki,qk->qi", weighted, height)[..., None])[..., 0]
    mass = belongs.sum(axis=1)
    layer = weight * (np.abs(residual) < _LAYER_M)
    rough = np.sqrt((layer * residual**2).sum(axis=1) / np.maximum(layer.sum(axis=1), 1e-12))
    return plane, rough, mass
