"""Weights of all terms. Every robust term is a negative log-likelihood: residuals are divided by their deviation."""

import math
from dataclasses import dataclass

ROOT_ACCELERATION = 4.0  # m/s^2, of a pelvis in lively motion


@dataclass(frozen=True)
class Weights:
    """How much each term counts, and the deviation at which its residual counts as one.

    A weight of 0 switches the term off. "Sizes" are a person's extent in the image, so that far and near people are
    treated alike; speeds and soles are measured in metres.

    Attributes:
        joints: 2D keypoints.
        joints_sigma: deviation of a keypoint, in person sizes.
        smpl: pose stays near the fitted pose theta^.
        theta_sigma: radians.
        betas: shape stays near betas^.
        stature_sigma: deviation of log stature at unit scale that betas may cause.
        height: prior on stature.
        height_mean_m: metres; the world's adults, men 1.71 and women 1.59 (NCD Risk Factor Collaboration 2016).
        height_sigma: deviation of log stature of adults.
        child_share: how many people are children, and with them who is unusually small.
        child_mean_m: metres.
        child_sigma: deviation of log stature of children.
        speed: root motion between frames.
        speed_sigma: body heights a second.
        acceleration: root acceleration.
        acceleration_sigma: metres of an average body a second squared.
        depth: body depth against the depth map.
        depth_sigma: deviation of log depth of the network.
        silhouette: contour of the body on the edge of its mask, as strong as this many independent samples a frame.
        silhouette_sigma: deviation of a mask's edge, in person sizes.
        contact: soles on the ground while they are in contact.
        contact_sigma: metres.
        penetration: no sole below the ground.
        collision: spheres of a body and of others do not overlap.
        collision_sigma: metres.
        slip: soles rest while they are in contact.
        slip_sigma: metres a second.
        temporal: vertices move as their filtered selves.
        temporal_sigma: metres a second.
        tilt_sigma: radians by which the ground may still tilt about the first fit.
        guard_sigma: log of the ratio by which scales and the ground's distance may still change, frame by frame.
        focal_sigma: log of the ratio by which the focal length may be wrong; 0 where it is known.
        effective_samples: how many independent measurements a clip's frames amount to for errors that persist, such
            as those of a depth network: it balances them against priors that hold once for each person.
    """

    joints: float = 1.0
    joints_sigma: float = 0.02
    smpl: float = 0.3
    theta_sigma: float = 0.15
    betas: float = 0.1
    stature_sigma: float = 0.01
    height: float = 1.0
    height_mean_m: float = 1.65
    height_sigma: float = 0.06
    child_share: float = 0.2
    child_mean_m: float = 1.2
    child_sigma: float = 0.2
    speed: float = 0.02
    speed_sigma: float = 1.0
    acceleration: float = 1.0
    acceleration_sigma: float = ROOT_ACCELERATION
    depth: float = 1.0
    depth_sigma: float = 0.12
    silhouette: float = 6.0
    silhouette_sigma: float = 0.02
    contact: float = 1.0
    contact_sigma: float = 0.02
    penetration: float = 4.0
    collision: float = 1.0
    collision_sigma: float = 0.05
    slip: float = 16.0
    slip_sigma: float = 0.05
    temporal: float = 0.7
    temporal_sigma: float = 0.4
    tilt_sigma: float = math.radians(0.5)
    guard_sigma: float = 0.01
    focal_sigma: float = 0.0
    effective_samples: float = 4.0

    @staticmethod
    def terms() -> tuple[str, ...]:
        """Names of the weights that switch a term; the other fields are deviations and means."""
        return (
            "joints", "smpl", "betas", "height", "speed", "acceleration", "depth", "silhouette", "contact",
            "penetration", "collision", "slip", "temporal",
        )  # fmt: skip

    def statures(self) -> tuple[tuple[float, float, float], ...]:
        """Share, mean and deviation of log stature in metres, of adults and of children."""
        return (
            (1 - self.child_share, math.log(self.height_mean_m), self.height_sigma),
            (self.child_share, math.log(self.child_mean_m), self.child_sigma),
        )
