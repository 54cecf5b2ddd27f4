"""What the geometry tests draw: vectors of sane size, directions, and rotations that crowd around 0 and pi."""

import math

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

VECTORS = hnp.arrays(float, 3, elements=st.floats(-10, 10, allow_subnormal=False))
DIRECTIONS = VECTORS.filter(lambda v: np.linalg.norm(v) > 1e-2).map(lambda v: v / np.linalg.norm(v))

# Where formulas break: no turn at all, turns below the square root of rounding, and around half a turn.
_HARD_ANGLES = st.sampled_from([0.0, 1e-300, 1e-16, 1e-9, 1e-8, 1e-7, 1e-4, math.pi - 1e-9, math.pi - 1e-5, math.pi])
ANGLES = st.one_of(_HARD_ANGLES, st.floats(0, math.pi))
ROTVECS = st.builds(lambda axis, angle: axis * angle, DIRECTIONS, ANGLES)
