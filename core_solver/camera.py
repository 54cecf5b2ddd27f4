"""Intrinsics: projection, distortion, field of view, and the camera files users have.

Pixels: u right, v down, the centre of the top-left pixel at (0.5, 0.5). Camera frame: OpenCV, metres.
"""

import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.errors import CameraError
from core_solver.take.model import CameraModel

DEFAULT_FOV_DEGREES = 55.0  # along the longer side: a phone's main camera has 65, an ordinary lens 40 to 55

# Centres of pixels lie at half-integers here and at integers in OpenCV's calibration tools.
_OPENCV_PIXEL_SHIFT = 0.5

_WIDEST = 20.0  # tangent of the angle from the axis, 87 degrees

# Rows and columns where a camera matrix has nothing.
_ZEROS = ((0, 1, 2, 2), (1, 0, 0, 1))


@dataclass(frozen=True)
class Camera(CameraModel):
    """`CameraModel` of a take together with its geometry."""

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(3, 3) pinhole matrix K."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], float)

    @property
    def is_distorted(self) -> bool:
        """Whether any distortion coefficient is not zero."""
        return any(self.distortion)

    @property
    def fov_degrees(self) -> float:
        """Field of view along the longer image side."""
        size, focal = max((self.width, self.fx), (self.height, self.fy))
        return math.degrees(2 * math.atan(size / (2 * focal)))

    def project(self, points: ArrayLike, *, distorted: bool = True) -> NDArray[np.float64]:
        """Project camera-frame points (..., 3) in metres to pixels (..., 2); points need z > 0."""
        points = np.asarray(points, float)
        if not (distorted and self.is_distorted) or points.size == 0:
            return points[..., :2] / points[..., 2:] * (self.fx, self.fy) + (self.cx, self.cy)
        rays = (points[..., :2] / points[..., 2:]).reshape(-1, 2)
        # Beyond the angle where the lens polynomial turns back, far outside the picture, it would fold points into it:
        # from there on they go on outwards.
        beyond = np.maximum(np.linalg.norm(rays, axis=1, keepdims=True) / self._turning_radius(), 1.0)
        inside = np.concatenate([rays / beyond, np.ones((len(rays), 1))], axis=1)
        pixels, _ = cv2.projectPoints(inside[:, None], np.zeros(3), np.zeros(3), self.matrix, np.array(self.distortion))
        centre = np.array([self.cx, self.cy])
        return (centre + (np.asarray(pixels, np.float64)[:, 0] - centre) * beyond).reshape(*points.shape[:-1], 2)

    def _turning_radius(self) -> float:
        """Tangent of the angle where r (1 + k1 r^2 + k2 r^4 + k3 r^6) no longer grows; perhaps infinite."""
        k1, k2, _, _, k3 = self.distortion
        squares = np.linspace(0, _WIDEST, 4000) ** 2
        growth = 1 + 3 * k1 * squares + 5 * k2 * squares**2 + 7 * k3 * squares**3
        turns = np.flatnonzero(growth <= 0)
        return float(np.sqrt(squares[turns[0] - 1])) if len(turns) else math.inf

    def undistort(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Pixels (..., 2) of the footage to the pixels of an ideal pinhole with the same K."""
        pixels = np.asarray(pixels, float)
        if not self.is_distorted or pixels.size == 0:
            return pixels.copy()
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-10)
        flat = cv2.undistortPointsIter(
            pixels.reshape(-1, 1, 2), self.matrix, np.array(self.distortion), None, self.matrix, criteria  # type: ignore[call-overload]
        )  # fmt: skip
        return flat.reshape(pixels.shape)

    def rays(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Viewing rays (..., 3) with z = 1 through footage pixels (..., 2)."""
        ideal = self.undistort(pixels)
        xy = (ideal - (self.cx, self.cy)) / (self.fx, self.fy)
        return np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)

    def grid_rays(self, height: int, width: int) -> NDArray[np.float64]:
        """Rays (height, width, 3) with z = 1 through the cell centres of a grid laid over the whole image."""
        u = (np.arange(width) + 0.5) * self.width / width
        v = (np.arange(height) + 0.5) * self.height / height
        return self.rays(np.stack(np.meshgrid(u, v), axis=-1))

    def as_model(self) -> CameraModel:
        """The plain record stored in a take."""
        return CameraModel(**{name: getattr(self, name) for name in CameraModel.__dataclass_fields__})


@dataclass(frozen=True)
class CameraEstimate:
    """A camera and how well its focal length is known.

    Attributes:
        camera: intrinsics.
        focal_sigma: deviation of log focal length; 0 where it is calibrated or given, or nothing says how well it is
            known.
    """

    camera: Camera
    focal_sigma: float = 0.0

    def stated(self) -> Camera:
        """The camera, whose source also tells the deviation."""
        doubt = f", give or take {100 * self.focal_sigma:.0f} %" if self.focal_sigma > 0 else ""
        return replace(self.camera, source=self.camera.source + doubt)


def camera_from_model(model: CameraModel) -> Camera:
    """The geometry of a take's camera record."""
    return Camera(**{name: getattr(model, name) for name in CameraModel.__dataclass_fields__})


def camera_from_fov(width: int, height: int, fov_degrees: float, source: str) -> Camera:
    """A pinhole with square pixels and centred principal point.

    Args:
        width: pixels.
        height: pixels.
        fov_degrees: angle along the longer image side.
        source: where the angle comes from, for the take.

    Raises:
        CameraError: the angle is outside 5 to 150 degrees.
    """
    if not 5 <= fov_degrees <= 150:
        raise CameraError(f"a field of view of {fov_degrees:g} degrees is not believable: give 5 to 150")
    focal = max(width, height) / (2 * math.tan(math.radians(fov_degrees) / 2))
    return Camera(width, height, focal, focal, width / 2, height / 2, source=source)


def read_camera(spec: str, width: int, height: int) -> Camera:
    """Read intrinsics for a video of the given size.

    Args:
        spec: a path, or `PATH:NAME` where the file holds several cameras (QTM .qca.txt). Known files: our JSON
            (a take's `camera` entry), OpenCV YAML or XML, a plain 3x3 text matrix, QTM calibration. JSON and text
            count pixels as we do, from the corner of the picture; OpenCV and QTM from the first pixel's centre.
        width: of the video as shown, pixels.
        height: of the video as shown, pixels.

    Raises:
        CameraError: missing, unreadable, or made for another image size or shape.
    """
    try:
        path, name = _split_spec(spec)
        if path.is_file():
            return _fit_to_video(_reader(path)(path, name, width, height), path, width, height)
    except CameraError:
        raise
    except Exception as error:  # a file that is something else raises almost anything
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise CameraError(f"{Path(spec).name} is not a camera file this program reads ({reason})") from error
    raise CameraError(f"no camera file at {path}: check the path given with --camera")


def _split_spec(spec: str) -> tuple[Path, str | None]:
    if Path(spec).exists():
        return Path(spec), None
    head, colon, tail = spec.rpartition(":")
    # A colon in second place is a Windows drive letter, not a camera name.
    return (Path(head), tail) if colon and len(head) > 1 else (Path(spec), None)


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8-sig")  # some Windows editors put a mark before the first letter


_Reader = Callable[[Path, str | None, int, int], Camera]


def _reader(path: Path) -> _Reader:
    name = path.name.lower()
    if name.endswith((".qca.txt", ".qca")):
        return _read_qtm
    if name.endswith(".json"):
        return _read_json
    if name.endswith((".yml", ".yaml", ".xml")):
        return _read_opencv
    return _read_matrix


def _read_json(path: Path, _name: str | None, width: int, height: int) -> Camera:
    document: dict[str, Any] = json.loads(_text(path))
    record = document.get("camera", document)
    k1, k2, p1, p2, k3 = (float(x) for x in record.get("distortion", (0.0,) * 5))
    return Camera(
        int(record.get("width", width)),
        int(record.get("height", height)),
        float(record["fx"]),
        float(record["fy"]),
        float(record["cx"]),
        float(record["cy"]),
        (k1, k2, p1, p2, k3),
        source=f"file {path.name}",
    )


def _read_matrix(path: Path, _name: str | None, width: int, height: int) -> Camera:
    lines = (line.partition("#")[0].replace(",", " ").split() for line in _text(path).splitlines())
    K = np.array([words for words in lines if words], float)
    return _from_matrix(K, np.zeros(5), width, height, f"file {path.name}")


def _read_opencv(path: Path, _name: str | None, width: int, height: int) -> Camera:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    K = _opencv_matrix(storage, "camera_matrix", "Camera_Matrix", "cameraMatrix", "K")
    if K is None:
        raise CameraError(f"{path.name} has no camera_matrix: write it with OpenCV's calibration")
    coefficients = _opencv_matrix(storage, "distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "D")
    distortion = np.zeros(5) if coefficients is None else coefficients.ravel()
    if distortion.size > 5 and np.any(distortion[5:]):
        raise CameraError(f"{path.name} uses OpenCV's rational or thin-prism lens model: calibrate with k1 k2 p1 p2 k3")
    sizes = [storage.getNode(n).real() for n in ("image_width", "image_Width", "image_height", "image_Height")]
    own_width, own_height = int(max(sizes[:2])) or width, int(max(sizes[2:])) or height
    distortion = np.concatenate([distortion, np.zeros(5)])[:5]
    return _from_matrix(K, distortion, own_width, own_height, f"file {path.name}", shift=_OPENCV_PIXEL_SHIFT)


def _opencv_matrix(storage: cv2.FileStorage, *names: str) -> NDArray[np.float64] | None:
    """The first of the named matrices. Number by number: OpenCV's own `mat()` misreads "0" and "1" without a point."""
    for node in map(storage.getNode, names):
        if not node.empty():
            rows, columns = (int(node.getNode(side).real()) for side in ("rows", "cols"))
            data = node.getNode("data")
            return np.array([data.at(i).real() for i in range(data.size())]).reshape(rows, columns)
    return None


def _read_qtm(path: Path, name: str | None, _width: int, _height: int) -> Camera:
    text = _text(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise CameraError(f"{path.name} declares XML entities: that is no QTM calibration")
    cameras = {c.get("serial", ""): c for c in ET.fromstring(text).iter("camera")}  # noqa: S314 - checked above
    if name is None and len(cameras) == 1:
        name = next(iter(cameras))
    if name not in cameras:
        raise CameraError(f"{path.name} has the cameras {', '.join(sorted(cameras))}: name one as {path.name}:NAME")
    field = cameras[name].find("fov_video")
    intrinsic = cameras[name].find("intrinsic")
    if field is None or intrinsic is None:
        raise CameraError(f"camera {name} of {path.name} has no intrinsics")

    def number(key: str) -> float:
        return float(intrinsic.attrib[key])

    left, top = float(field.attrib["left"]), float(field.attrib["top"])
    # QTM stores intrinsics in 1/64 pixel.
    focal_u, focal_v = number("focalLengthU") / 64, number("focalLengthV") / 64
    return Camera(
        width=round(float(field.attrib["right"]) - left) + 1,
        height=round(float(field.attrib["bottom"]) - top) + 1,
        fx=focal_u,
        fy=focal_v,
        cx=number("centerPointU") / 64 - left + _OPENCV_PIXEL_SHIFT,
        cy=number("centerPointV") / 64 - top + _OPENCV_PIXEL_SHIFT,
        distortion=(
            number("radialDistortion1"),
            number("radialDistortion2"),
            number("tangentalDistortion1"),
            number("tangentalDistortion2"),
            number("radialDistortion3"),
        ),
        source=f"file {path.name}, camera {name}",
    )


def _from_matrix(
    K: NDArray[np.float64], distortion: NDArray[np.float64], width: int, height: int, source: str, shift: float = 0.0
) -> Camera:
    # A transposed matrix, as MATLAB has it, or pixels that are not upright would pass for another camera.
    if K.shape != (3, 3) or not np.allclose(K[_ZEROS], 0, atol=1e-3 * K[0, 0]) or K[2, 2] != 1:
        raise CameraError("the camera matrix must read fx 0 cx / 0 fy cy / 0 0 1")
    k1, k2, p1, p2, k3 = (float(x) for x in distortion)
    return Camera(
        width, height, float(K[0, 0]), float(K[1, 1]), float(K[0, 2]) + shift, float(K[1, 2]) + shift,
        (k1, k2, p1, p2, k3), source,
    )  # fmt: skip


def _fit_to_video(camera: Camera, path: Path, width: int, height: int) -> Camera:
    """Scale intrinsics of a larger or smaller copy of the same picture; refuse another shape."""
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion)
    if not (np.all(np.isfinite(numbers)) and min(camera.fx, camera.fy, camera.width, camera.height) > 0):
        raise CameraError(f"{path.name} holds impossible numbers: focal lengths and image size must be positive")
    across, down = width / camera.width, height / camera.height
    if abs(across / down - 1) > 0.01:
        raise CameraError(
            f"{path.name} is for {camera.width}x{camera.height} pixels but the video has {width}x{height}: "
            "use the calibration of this camera mode (or rotate the video)"
        )
    if not (0 <= camera.cx * across <= width and 0 <= camera.cy * down <= height):
        raise CameraError(f"{path.name} puts the image centre outside a {width}x{height} picture: wrong camera file?")
    note = "" if (across, down) == (1, 1) else f", scaled from {camera.width}x{camera.height}"
    return Camera(
        width, height, camera.fx * across, camera.fy * down, camera.cx * across, camera.cy * down,
        camera.distortion, camera.source + note,
    )  # fmt: skip
