"""Relative depth of a picture by any MiDaS-like ONNX network: disparity, near = large, scale and shift unknown."""

import logging
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import ModelError
from core_solver.perception.onnx_session import open_session

Image = NDArray[np.uint8]
Floats = NDArray[np.float32]

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Convention:
    """How a family of networks wants its picture: `(rgb / divisor - mean) / std`, channels first.

    Attributes:
        pattern: regular expression on the file's name, lower case.
        divisor: of the 8-bit values.
        mean: subtracted per channel.
        std: divided by per channel.
        long_side: pixels, for networks that leave the size free.
        multiple: of which free sides must be.
    """

    pattern: str
    divisor: float
    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    long_side: int
    multiple: int


_IMAGENET = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))

CONVENTIONS = (
    Convention(r"tcmonodepth", 1, (0, 0, 0), (1, 1, 1), 448, 32),
    Convention(r"dpt", 255, (0.5, 0.5, 0.5), (0.5, 0.5, 0.5), 384, 32),
    Convention(r"depth[-_ ]?anything|depthanything", 255, *_IMAGENET, 518, 14),
    # MiDaS's own ONNX files take mean and deviation out themselves; other people's exports of it do not.
    Convention(r"^model-(small|f6b98070|f46da743)\b", 255, (0, 0, 0), (1, 1, 1), 384, 32),
    Convention(r"midas", 255, *_IMAGENET, 384, 32),
)
"""The first whose pattern occurs in the file's name holds; if none does, that of its folder counts."""

_UNKNOWN = Convention("", 255, *_IMAGENET, 384, 32)

_PERCENTILES = (0.5, 99.5)  # a few wild pixels must not set the range
_STEEP = 8.0  # ranges per picture length: floors reach 2 to 3, the blur between a person and a wall more than 10
_WIDEST_BLUR = 0.02  # of the picture length


class DisparityNetwork:
    """A disparity network as an ONNX file of fixed or free input size."""

    def __init__(self, path: Path) -> None:
        """Load the network.

        Args:
            path: ONNX file with one input (1, 3, h, w) and an output (1, h, w) or (1, 1, h, w).

        Raises:
            ModelError: unreadable, or input or output are of another kind.
        """
        self.path = path
        self._session = open_session(path)
        inputs = self._session.get_inputs()
        if len(inputs) != 1 or len(inputs[0].shape) != 4 or inputs[0].shape[1] not in (3, "3"):
            shapes = ", ".join(str(i.shape) for i in inputs)
            raise ModelError(
                f"{path.name} takes {shapes} and is no depth network, which takes one picture (1, 3, height, width): "
                "give another one with --depth"
            )
        if inputs[0].type not in _TYPES:
            raise ModelError(f"{path.name} takes {inputs[0].type}: a disparity network takes float pictures")
        self._name = inputs[0].name
        self._type = _TYPES[inputs[0].type]
        self._sides = inputs[0].shape[2:]
        self._convention = convention_for(path)

    def __call__(self, image: Image) -> NDArray[np.float16]:
        """Disparity of a (H, W, 3) BGR picture.

        Returns:
            (h, w) in [0, 1] at the network's own size, laid over the whole picture, near = large; edges are steps.

        Raises:
            ModelError: the network's output is no picture of numbers.
        """
        height, width = self._input_size(image.shape[1], image.shape[0])
        tensor = to_tensor(image, width, height, self._convention).astype(self._type)
        try:
            raw = np.asarray(self._session.run(None, {self._name: tensor})[0])
        except Exception as error:  # onnxruntime's errors have no public base class
            raise ModelError(f"{self.path.name} does not run on a {width}x{height} picture: use another one") from error
        plane = np.squeeze(raw)
        if plane.ndim != 2 or min(plane.shape) < 8:
            raise ModelError(f"{self.path.name} gives {raw.shape}: a disparity network gives one value per pixel")
        return sharpen_edges(normalise(plane.astype(np.float32))).astype(np.float16)

    def _input_size(self, width: int, height: int) -> tuple[int, int]:
        """(height, width): what the graph fixes, else the picture's shape at the family's size."""
        free_height, free_width = free_size(width, height, self._convention)
        fixed_height, fixed_width = self._sides
        return (
            fixed_height if isinstance(fixed_height, int) else free_height,
            fixed_width if isinstance(fixed_width, int) else free_width,
        )


def open_disparity(files: Sequence[Path], width: int, height: int) -> DisparityNetwork | None:
    """The network among these files whose shape is nearest the picture's; None if there are none.

    Raises:
        ModelError: the chosen one is not a disparity network.
    """
    if not files:
        return None
    return DisparityNetwork(nearest_shape(files, width / height))


def disparity_files(path: Path) -> tuple[Path, ...]:
    """The network file itself, or all .onnx files of a folder.

    Raises:
        ModelError: there is nothing.
    """
    if path.is_file():
        return (path,)
    files = tuple(sorted(path.glob("*.onnx"))) if path.is_dir() else ()
    if not files:
        raise ModelError(f"no depth network at {path}: give an .onnx file or a folder with some")
    return files


def nearest_shape(files: Sequence[Path], aspect: float) -> Path:
    """The file made for the aspect (width / height) nearest to this one; a name without a size fits any."""

    def misfit(file: Path) -> float:
        size = re.search(r"(\d{2,5})x(\d{2,5})", file.stem)
        return abs(math.log(int(size[2]) / int(size[1]) / aspect)) if size else 0.0

    return min(files, key=misfit)


def convention_for(path: Path) -> Convention:
    """The family's convention by the name of the file or its folder; ImageNet's for names that tell nothing."""
    for name in (path.name.lower(), path.parent.name.lower()):
        for convention in CONVENTIONS:
            if re.search(convention.pattern, name):
                return convention
    _log.warning("%s tells no known family of depth networks: the usual picture normalisation is assumed", path.name)
    return _UNKNOWN


def free_size(width: int, height: int, convention: Convention) -> tuple[int, int]:
    """(height, width) for a network that leaves the size free."""
    columns, rows = rounded_size(width, height, convention.long_side, convention.multiple)
    return rows, columns


def rounded_size(width: int, height: int, long_side: int, multiple: int) -> tuple[int, int]:
    """(width, height) near the picture's shape, the longer side near `long_side`, both multiples of a number."""
    scale = long_side / max(width, height) / multiple
    return max(round(width * scale), 1) * multiple, max(round(height * scale), 1) * multiple


def to_tensor(image: Image, width: int, height: int, convention: Convention) -> Floats:
    """(1, 3, height, width) from a BGR picture, stretched."""
    shrinks = width < image.shape[1]
    small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    rgb = small[..., ::-1].astype(np.float32) / convention.divisor
    rgb = (rgb - np.float32(convention.mean)) / np.float32(convention.std)  # type: ignore[arg-type]
    return np.ascontiguousarray(rgb.transpose(2, 0, 1)[None])


def normalise(raw: Floats) -> Floats:
    """Stretch the values between two percentiles to [0, 1]; a flat or empty picture becomes 0."""
    finite = np.isfinite(raw)
    if not finite.any():
        return np.zeros_like(raw)
    low, high = np.percentile(raw[finite], _PERCENTILES)
    if high - low < 1e-6 * max(abs(high), 1e-6):
        return np.zeros_like(raw)
    return np.clip((np.where(finite, raw, low) - low) / (high - low), 0, 1).astype(np.float32)


def sharpen_edges(disparity: Floats) -> Floats:
    """Make steps of blurred edges: values between a person and the wall behind would hang in the air.

    Pixels where the disparity is steep take the value of the nearest pixel where it is not; so a blurred edge becomes a
    step in the middle of the blur.
    """
    length = max(disparity.shape)
    down, across = np.gradient(disparity)
    steep = np.hypot(down, across) > _STEEP / length
    if not steep.any() or steep.all():
        return disparity
    distance, nearest = cv2.distanceTransformWithLabels(
        steep.astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    # Each calm pixel has its own label; look up its value by that label.
    values = np.zeros(int(nearest.max()) + 1, np.float32)
    values[nearest[~steep]] = disparity[~steep]
    return np.where(steep & (distance <= _WIDEST_BLUR * length), values[nearest], disparity)


_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
