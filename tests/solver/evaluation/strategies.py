import numpy as np
from hypothesis import strategies as st

from core_solver.geometry import Similarity, matrix_from_rotvec


@st.composite
def rigid_motions(draw) -> Similarity:
    number = st.floats(-3, 3, allow_nan=False)
    vector = st.tuples(number, number, number).map(np.array)
    return Similarity(matrix_from_rotvec(draw(vector)), draw(vector))


def crowd(people=3, frames=12, joints=24, seed=0) -> np.ndarray:
    """Joints (N, T, J, 3) of people who stand about and move, in front of the camera."""
    rng = np.random.default_rng(seed)
    places = np.stack([np.linspace(-2, 2, people), np.zeros(people), np.linspace(5, 9, people)], axis=-1)
    bodies = rng.normal(size=(people, 1, joints, 3)) * 0.4
    motion = np.cumsum(rng.normal(size=(people, frames, 1, 3)) * 0.02, axis=1)
    limbs = np.cumsum(rng.normal(size=(people, frames, joints, 3)) * 0.01, axis=1)
    return places[:, None, None] + bodies + motion + limbs


def everywhere(points: np.ndarray) -> np.ndarray:
    """The mask (N, T) that leaves nothing out."""
    return np.ones(points.shape[:2], bool)
