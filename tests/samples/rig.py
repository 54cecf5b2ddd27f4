"""The sample rig: a stocky figure with the bone names of Mixamo, as a GLB written by hand."""

import json
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import quaternion_from_matrix
from core_solver.take import JOINT_NAMES
from tests.samples.figure import Build, Figure, build_figure

Array = NDArray[np.float64]

BUILD = Build(legs=0.82, arms=0.9, head=1.45, bulk=1.15, sides=8)
NAME = "Sample Rig"
_PREFIX = "mixamorig:"
_FLOAT, _UBYTE, _UINT = 5126, 5121, 5125
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963
_COLOUR = (0.62, 0.55, 0.78, 1.0)


@dataclass(frozen=True)
class Bone:
    """One bone of the rig.

    Attributes:
        name: as Mixamo calls it, without its prefix.
        parent: name; empty for the hips.
        joint: of the figure where it begins.
        towards: joint or point (3,) that it points at.
    """

    name: str
    parent: str
    joint: str
    towards: str | tuple[float, float, float]


def _bones() -> tuple[Bone, ...]:
    sides = []
    for side in ("Left", "Right"):
        low = side.lower()
        sides += [
            Bone(f"{side}Shoulder", "Spine2", f"{low}_collar", f"{low}_shoulder"),
            Bone(f"{side}Arm", f"{side}Shoulder", f"{low}_shoulder", f"{low}_elbow"),
            Bone(f"{side}ForeArm", f"{side}Arm", f"{low}_elbow", f"{low}_wrist"),
            Bone(f"{side}Hand", f"{side}ForeArm", f"{low}_wrist", f"{low}_hand"),
            Bone(f"{side}UpLeg", "Hips", f"{low}_hip", f"{low}_knee"),
            Bone(f"{side}Leg", f"{side}UpLeg", f"{low}_knee", f"{low}_ankle"),
            Bone(f"{side}Foot", f"{side}Leg", f"{low}_ankle", f"{low}_foot"),
            Bone(f"{side}ToeBase", f"{side}Foot", f"{low}_foot", (0.0, 0.0, 1.0)),
        ]
    return (
        Bone("Hips", "", "pelvis", "spine1"),
        Bone("Spine", "Hips", "spine1", "spine2"),
        Bone("Spine1", "Spine", "spine2", "spine3"),
        Bone("Spine2", "Spine1", "spine3", "neck"),
        Bone("Neck", "Spine2", "neck", "head"),
        Bone("Head", "Neck", "head", (0.0, 1.0, 0.0)),
        *sides,
    )


BONES = _bones()


def write_rig() -> bytes:
    """The GLB file: metres, y up, facing +z, in a T-pose."""
    figure = build_figure(BUILD)
    buffer = _Buffer()
    heads, axes = _rest(figure)
    bind = np.tile(np.eye(4), (len(BONES), 1, 1))
    bind[:, :3, :3], bind[:, :3, 3] = axes, heads
    attributes = {
        "POSITION": buffer.add(figure.vertices.astype("<f4"), "VEC3", _FLOAT, _ARRAY_BUFFER, bounds=True),
        "NORMAL": buffer.add(_normals(figure).astype("<f4"), "VEC3", _FLOAT, _ARRAY_BUFFER),
        "JOINTS_0": buffer.add(_carriers(figure), "VEC4", _UBYTE, _ARRAY_BUFFER),
        "WEIGHTS_0": buffer.add(figure.weights.astype("<f4"), "VEC4", _FLOAT, _ARRAY_BUFFER),
    }
    faces = buffer.add(figure.faces.astype("<u4").reshape(-1), "SCALAR", _UINT, _ELEMENT_BUFFER)
    inverse = np.swapaxes(np.linalg.inv(bind), 1, 2).reshape(-1, 16).astype("<f4")
    skin = {"name": NAME, "joints": list(range(2, 2 + len(BONES))), "skeleton": 2}
    skin["inverseBindMatrices"] = buffer.add(inverse, "MAT4", _FLOAT, None)
    document = {
        "asset": {"version": "2.0", "generator": "Scene-Aware Mocap samples", "copyright": "CC0-1.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": NAME, "children": [1, 2]},
            {"name": "Sample Body", "mesh": 0, "skin": 0},
            *_bone_nodes(heads, axes),
        ],
        "meshes": [
            {"name": "Sample Body", "primitives": [{"attributes": attributes, "indices": faces, "material": 0}]}
        ],
        "materials": [{"name": "Sample", "pbrMetallicRoughness": {"baseColorFactor": _COLOUR, "metallicFactor": 0.0}}],
        "skins": [skin],
        "buffers": [{"byteLength": len(buffer.data)}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    length = 12 + 8 + len(text) + 8 + len(buffer.data)
    return b"".join([
        struct.pack("<4sII", b"glTF", 2, length),
        struct.pack("<I4s", len(text), b"JSON"), text,
        struct.pack("<I4s", len(buffer.data), b"BIN\0"), bytes(buffer.data),
    ])  # fmt: skip


class _Buffer:
    """The file's binary part while it is filled."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, array: NDArray[Any], kind: str, component: int, target: int | None, *, bounds: bool = False) -> int:
        """Append an array; gives its accessor's number."""
        raw = np.ascontiguousarray(array).tobytes()
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(raw)}
        self.data += raw + b"\0" * (-len(raw) % 4)
        accessor: dict[str, Any] = {
            "bufferView": len(self.views), "componentType": component, "count": len(array), "type": kind,
        }  # fmt: skip
        if target is not None:
            view["target"] = target
        if bounds:
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self.views.append(view)
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _rest(figure: Figure) -> tuple[Array, Array]:
    """Heads (B, 3) and axes (B, 3, 3) of the bones: y along the bone, z as near to the figure's front as can be."""
    places = dict(zip(JOINT_NAMES, figure.joints, strict=True))
    heads = np.array([places[bone.joint] for bone in BONES])
    axes = []
    for bone, head in zip(BONES, heads, strict=True):
        along = np.array(bone.towards) if isinstance(bone.towards, tuple) else places[bone.towards] - head
        along = along / np.linalg.norm(along)
        front = np.array([0.0, 1.0, 0.0]) if abs(along[2]) > 0.7 else np.array([0.0, 0.0, 1.0])
        front = front - (front @ along) * along
        front /= np.linalg.norm(front)
        axes.append(np.stack([np.cross(along, front), along, front], axis=1))
    return heads, np.array(axes)


def _bone_nodes(heads: Array, axes: Array) -> list[dict[str, Any]]:
    names = [bone.name for bone in BONES]
    nodes = []
    for number, bone in enumerate(BONES):
        turn, place = axes[number], heads[number]
        if bone.parent:
            parent = names.index(bone.parent)
            turn, place = axes[parent].T @ turn, axes[parent].T @ (place - heads[parent])
        w, x, y, z = quaternion_from_matrix(turn).tolist()
        node: dict[str, Any] = {"name": _PREFIX + bone.name, "translation": place.tolist(), "rotation": [x, y, z, w]}
        children = [2 + i for i, other in enumerate(BONES) if other.parent == bone.name]
        if children:
            node["children"] = children
        nodes.append(node)
    return nodes


def _carriers(figure: Figure) -> NDArray[np.uint8]:
    """(V, 4) numbers of the bones; fingers belong to the hand, which is the rig's last bone there."""
    owner = {bone.joint: number for number, bone in enumerate(BONES)}
    for side in ("left", "right"):
        owner[f"{side}_hand"] = owner[f"{side}_wrist"]
    table = np.array([owner[name] for name in JOINT_NAMES], np.uint8)
    # glTF wants 0 where a weight is 0, and no bone twice: a hand's two weights are summed by whoever reads them.
    return np.where(figure.weights > 0, table[figure.weight_joints], 0).astype(np.uint8)


def _normals(figure: Figure) -> Array:
    corners = figure.vertices[figure.faces]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(figure.vertices)
    for corner in range(3):
        np.add.at(normals, figure.faces[:, corner], outward)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
