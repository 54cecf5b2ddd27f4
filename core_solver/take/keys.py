"""The file's keys and array types, once for reading and writing. A `None` in a shape is any length."""

from typing import NamedTuple

import numpy as np


class ArraySpec(NamedTuple):
    """Type and shape of an array in the file; "T", "V" and such name lengths that must agree within a person."""

    dtype: type[np.generic]
    shape: tuple[int | str, ...]


META = "meta"
TIMES = "times"
PERSON = "people/{index}/{field}"
SCENE = "scene/{field}"
STEADYING = "steadying"  # may be missing

META_ARRAY = ArraySpec(np.uint8, ("n",))
TIMES_ARRAY = ArraySpec(np.float64, ("T",))
STEADYING_ARRAY = ArraySpec(np.float64, ("T", 3, 3))

PERSON_ARRAYS: dict[str, ArraySpec] = {
    "theta": ArraySpec(np.float32, ("T", 24, 3)),
    "gamma": ArraySpec(np.float32, ("T", 3)),
    "betas": ArraySpec(np.float32, (10,)),
    "scale": ArraySpec(np.float32, ()),
    "valid": ArraySpec(np.bool_, ("T",)),
    "confidence": ArraySpec(np.float32, ("T", 24)),
    "contacts": ArraySpec(np.float32, ("T", 2)),
    "rest_joints": ArraySpec(np.float32, (24, 3)),
    "rest_vertices": ArraySpec(np.float32, ("V", 3)),
    "faces": ArraySpec(np.int32, ("F", 3)),
    "weight_joints": ArraySpec(np.uint8, ("V", 4)),
    "weights": ArraySpec(np.float32, ("V", 4)),
}

SCENE_ARRAYS: dict[str, ArraySpec] = {
    "points": ArraySpec(np.float32, ("P", 3)),
    "colors": ArraySpec(np.uint8, ("P", 3)),
    "depth": ArraySpec(np.float32, ("H", "W")),
    "z_near": ArraySpec(np.float32, ("T",)),
    "z_far": ArraySpec(np.float32, ("T",)),
}

# Where a value may be missing, which is NaN.
MAY_BE_NAN = frozenset({"scene/depth"})
