"""One body model for everything downstream, whether it came from the open default or from a user's SMPL file."""

import hashlib
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.body.proxy import choose_proxy
from core_solver.body.smpl_file import read_smpl_arrays
from core_solver.body.smpl_keypoints import find_keypoints
from core_solver.errors import ModelError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BodyModel:
    """A linear body: shape moves the rest vertices, skinning poses them.

    Rest frame: SMPL's axes (y up, z to the front, x to the body's left), T-pose, metres.

    Attributes:
        id: "open-body-1" or "smpl-" and the first 8 digits of the file's sha256: betas mean nothing without it.
        licence: one line for the take file.
        template: (V, 3) rest vertices at betas = 0.
        shape_directions: (V, 3, 10) metres per unit of beta.
        pose_directions: (V, 3, 207) SMPL's pose corrections, or None.
        joint_regressor: (24, V) rows sum to 1.
        weights: (V, 24) skinning weights, rows sum to 1.
        faces: (F, 3) triangles, anticlockwise seen from outside.
        keypoint_regressor: (25, V) rows are non-negative and sum to 1.
        neutral_betas: (10,) an average adult. The open body's zero is a mean over all ages.
        proxy: (P,) about 500 vertices spread over the body with soles and hands: enough for vertex terms.
    """

    id: str
    licence: str
    template: Array
    shape_directions: Array
    pose_directions: Array | None
    joint_regressor: Array
    weights: Array
    faces: NDArray[np.int32]
    keypoint_regressor: Array
    neutral_betas: Array
    proxy: NDArray[np.int32]

    @cached_property
    def joint_template(self) -> Array:
        """(24, 3) rest joints at betas = 0, metres."""
        return self.joint_regressor @ self.template

    @cached_property
    def joint_directions(self) -> Array:
        """(24, 3, 10) how the rest joints move with betas."""
        return np.tensordot(self.joint_regressor, self.shape_directions, axes=1)

    @cached_property
    def keypoint_template(self) -> Array:
        """(25, 3) rest keypoints at betas = 0, metres."""
        return self.keypoint_regressor @ self.template

    @cached_property
    def keypoint_directions(self) -> Array:
        """(25, 3, 10) how the rest keypoints move with betas."""
        return np.tensordot(self.keypoint_regressor, self.shape_directions, axes=1)

    @cached_property
    def keypoint_weights(self) -> Array:
        """(25, 24) skinning weights of the keypoints: each is carried along like one more vertex."""
        return self.keypoint_regressor @ self.weights

    def rest_joints(self, betas: ArrayLike) -> Array:
        """Joints (24, 3) of the rest pose in metres, for (10,) betas; leading dimensions of betas are kept."""
        return self.joint_template + _directed(self.joint_directions, betas)

    def rest_vertices(self, betas: ArrayLike) -> Array:
        """Vertices (V, 3) of the rest pose in metres, for (10,) betas; leading dimensions of betas are kept."""
        return self.template + _directed(self.shape_directions, betas)

    def rest_keypoints(self, betas: ArrayLike) -> Array:
        """Keypoints (25, 3) of the rest pose in metres, for (10,) betas; leading dimensions of betas are kept."""
        return self.keypoint_template + _directed(self.keypoint_directions, betas)

    def height(self, betas: ArrayLike) -> float:
        """Stature in metres: the vertical extent of the rest vertices, soles to crown."""
        return float(np.ptp(self.rest_vertices(betas)[:, 1]))


def _directed(directions: Array, betas: ArrayLike) -> Array:
    """(n, 3, 10) directions applied to (..., 10) betas: (..., n, 3) offsets."""
    return np.tensordot(np.asarray(betas, float), directions, axes=([-1], [-1]))


def load_body(path: Path) -> BodyModel:
    """Load a body model of either kind, told apart by what the file holds.

    Raises:
        ModelError: neither an open body nor an SMPL file.
    """
    if not path.is_file():
        raise ModelError(f"{path}: no such body model file")
    if not zipfile.is_zipfile(path):
        return load_smpl(path)
    with zipfile.ZipFile(path) as archive:
        names = set(archive.namelist())
    return load_open_body(path) if "template.npy" in names else load_smpl(path)


def load_open_body(path: Path) -> BodyModel:
    """Load the npz that `build_open_body` writes.

    Raises:
        ModelError: missing, damaged or something else.
    """
    fields = (
        "template", "shape_directions", "joint_regressor", "weights", "faces", "keypoint_regressor", "neutral_betas",
        "proxy",
    )  # fmt: skip
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in fields}
            identity = {name: str(archive[name]) for name in ("id", "licence")}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ModelError(f"{path} is not an open body file (build it again): {error}") from error
    model = BodyModel(pose_directions=None, **identity, **arrays)
    count = len(model.template)
    if model.shape_directions.shape != (count, 3, 10) or model.weights.shape != (count, 24):
        raise ModelError(f"{path} is not an open body file (build it again): its arrays do not fit together")
    return model


def load_smpl(path: Path) -> BodyModel:
    """Load a user's SMPL file, .npz or .pkl; keypoints and proxy are derived from its geometry.

    Raises:
        ModelError: missing, damaged, not SMPL's 24 joints, or a pickle that holds more than arrays.
    """
    arrays = read_smpl_arrays(path)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return BodyModel(
        id=f"smpl-{digest[:8]}",
        licence="SMPL body model of the user, under the licence that came with it",
        template=arrays.template,
        shape_directions=arrays.shape_directions,
        pose_directions=arrays.pose_directions,
        joint_regressor=arrays.joint_regressor,
        weights=arrays.weights,
        faces=arrays.faces,
        keypoint_regressor=find_keypoints(arrays.template, arrays.joint_regressor, arrays.weights),
        neutral_betas=np.zeros(10),
        proxy=choose_proxy(arrays.template, arrays.weights),
    )
