"""Every kind of network that can be declared: its task, its outputs and the keys its declaration may hold.

A shape names one number per axis: an int is fixed, `ANY` is free, `KEYPOINTS` and its multiples follow the declared
keypoint set. An output has several shapes where families differ.
"""

from dataclasses import dataclass
from enum import Enum

ANY = -1
ROMP_CHANNELS = 3 + 22 * 6 + 10  # camera, rotations, shape

Shape = tuple["int | PerKeypoint", ...]


@dataclass(frozen=True)
class PerKeypoint:
    """A length of `times` numbers for each keypoint of the declared set, and `plus` others."""

    times: int = 1
    plus: int = 0


class View(Enum):
    """What a network is shown."""

    PICTURE = "picture"
    PERSON = "person"


@dataclass(frozen=True)
class Role:
    """One output of a kind of network.

    Attributes:
        name: how `[network.outputs]` calls it.
        shapes: the shapes it may have.
        usual: the names it usually has in ONNX files, tried when the declaration names none.
        optional: whether a network may do without.
    """

    name: str
    shapes: tuple[Shape, ...]
    usual: tuple[str, ...] = ()
    optional: bool = False


@dataclass(frozen=True)
class Kind:
    """What a decoder reads.

    Attributes:
        task: "pose", "masks", "depth" or "smpl".
        view: what the network is shown; None where the declaration says it with `sees`.
        roles: its outputs, in the order in which its decoder takes them.
        keys: what the declaration may hold besides the keys that every network has.
        settled: keys whose value follows from the kind.
    """

    task: str
    view: View | None
    roles: tuple[Role, ...]
    keys: tuple[str, ...]
    settled: tuple[tuple[str, str], ...] = ()


_CROP_KEYS = ("keypoints", "padding", "score")
_FOUND_KEYS = ("keypoints", "fit", "pad", "score", "overlap")
_MASK_KEYS = ("fit", "pad", "score", "person_class")
_DEPTH_KEYS = ("longer_side", "multiple")
_PLANES: tuple[Shape, ...] = ((1, ANY, ANY), (1, 1, ANY, ANY), (1, ANY, ANY, 1))

KINDS: dict[str, Kind] = {
    "heatmap": Kind(
        "pose",
        View.PERSON,
        (Role("heatmaps", ((ANY, PerKeypoint(), ANY, ANY),), ("heatmaps", "output")),),
        (*_CROP_KEYS, "refine", "udp"),
    ),
    "simcc": Kind(
        "pose",
        View.PERSON,
        (
            Role("x", ((ANY, PerKeypoint(), ANY),), ("simcc_x",)),
            Role("y", ((ANY, PerKeypoint(), ANY),), ("simcc_y",)),
        ),
        _CROP_KEYS,
    ),
    "rtmo": Kind(
        "pose",
        View.PICTURE,
        (
            Role("dets", ((1, ANY, 5),), ("dets",)),
            Role("keypoints", ((1, ANY, PerKeypoint(), 3),), ("keypoints",)),
        ),
        _FOUND_KEYS,
    ),
    "yolo-pose": Kind("pose", View.PICTURE, (Role("predictions", ((1, PerKeypoint(3, 5), ANY),)),), _FOUND_KEYS),
    "yolo-pose-end2end": Kind(
        "pose", View.PICTURE, (Role("predictions", ((1, ANY, PerKeypoint(3, 6)),)),), _FOUND_KEYS
    ),
    "rtmdet-ins": Kind(
        "masks",
        View.PICTURE,
        (
            Role("dets", ((1, ANY, 5),), ("dets",)),
            Role("labels", ((1, ANY),), ("labels",)),
            Role("masks", ((1, ANY, ANY, ANY),), ("masks",)),
        ),
        _MASK_KEYS,
    ),
    "yolo-seg": Kind(
        "masks",
        View.PICTURE,
        (
            Role("predictions", ((1, ANY, ANY),), ("output0",)),
            Role("protos", ((1, ANY, ANY, ANY),), ("output1",)),
        ),
        (*_MASK_KEYS, "overlap"),
    ),
    "mask2former": Kind(
        "masks",
        View.PICTURE,
        (
            Role("classes", ((1, ANY, ANY),), ("class_queries_logits", "pred_logits", "logits")),
            Role("masks", ((1, ANY, ANY, ANY),), ("masks_queries_logits", "pred_masks")),
        ),
        _MASK_KEYS,
    ),
    "disparity": Kind("depth", View.PICTURE, (Role("disparity", _PLANES),), _DEPTH_KEYS),
    "metric-depth": Kind(
        "depth",
        View.PICTURE,
        (Role("depth", _PLANES, ("predicted_depth",)), Role("focal", ((1,), (1, 1), ()), ("focallength_px",), True)),
        (*_DEPTH_KEYS, "focal"),
    ),
    "points": Kind(
        "depth",
        View.PICTURE,
        (
            Role("points", ((1, ANY, ANY, 3), (1, 3, ANY, ANY)), ("points",)),
            Role("mask", _PLANES, ("mask",), True),
        ),
        (*_DEPTH_KEYS, "shift"),
    ),
    "smpl": Kind(
        "smpl",
        None,
        (
            Role("pose", ((ANY, ANY, 3, 3), (ANY, ANY), (ANY, ANY, 3), (ANY, ANY, 6)), ("body_pose", "pose", "theta")),
            Role("orient", ((ANY, 1, 3, 3), (ANY, 3, 3), (ANY, ANY), (ANY, 1, 6)), ("global_orient",), True),
            Role("camera", ((ANY, 3),), ("pred_cam", "cam", "camera"), True),
            Role("scores", ((ANY,), (ANY, 1)), ("scores", "confidence"), True),
            Role("betas", ((ANY, ANY),), ("betas",), True),
        ),
        ("sees", "fit", "pad", "padding", "rotations", "camera", "axes", "fov_degrees", "score"),
    ),
    "romp-maps": Kind(
        "smpl",
        View.PICTURE,
        (
            Role("centers", ((1, 1, ANY, ANY),), ("center_maps",)),
            Role("params", ((1, ROMP_CHANNELS, ANY, ANY),), ("params_maps",)),
        ),
        ("fit", "pad", "axes", "score"),
        (("rotations", "6d"), ("camera", "romp")),
    ),
}
"""By the name that `decoder` gives."""

TASKS = ("pose", "masks", "depth", "smpl")


def decoders_of(task: str) -> tuple[str, ...]:
    """The decoders that serve a task."""
    return tuple(name for name, kind in KINDS.items() if kind.task == task)
