"""A scene as a binary glTF file (.glb): metres, y up, names, values, and motion as animation."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast._version import __version__
from graspcast.io.files import atomic_write
from graspcast.pose.transforms import quaternion
from graspcast.viewing.scene import Motion, Node, Scene

__all__ = ["glb_bytes", "write_glb"]

ROOT = "scene"
_JSON, _BIN, _FLOAT = 0x4E4F534A, 0x004E4942, 5126
_ROUGHNESS = 0.75
_LEAST = 1e-6
_ARRAY, _INDICES = 34962, 34963


def write_glb(path: str | PathLike[str], scene: Scene) -> None:
    """Write a scene as a .glb file, atomically; see :func:`glb_bytes`.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    content = glb_bytes(scene)
    with atomic_write(path) as temporary:
        temporary.write_bytes(content)


def glb_bytes(scene: Scene) -> bytes:
    """Return a scene as binary glTF 2.0.

    Its root node, ``scene``, turns the scene's frame so that y points up. Each node has its name
    and, as ``extras``, what it says of itself. The scene's ``extras`` hold title, frame, unit and
    legend. A motion is an animation called ``trial``.
    """
    tree, data = _split(_as_trimesh(scene).export(file_type="glb", include_normals=True))
    tree["asset"]["generator"] = f"graspcast {__version__}, trimesh"
    about = {node.name: node.about for node in scene.nodes if node.about}
    for node in tree["nodes"]:
        node["name"] = str(node["name"])
        _place(node)
        if node["name"] in about:
            node["extras"] = dict(about[node["name"]])
    for mesh in tree["meshes"]:
        mesh.pop("extras", None)
        for primitive in mesh["primitives"]:
            _name_targets(tree, primitive)
    tree["scenes"][0]["name"] = scene.title
    tree["scenes"][0]["extras"] = {
        "title": scene.title,
        "frame": f"{scene.frame}; the node {ROOT!r} turns it so that y points up",
        "unit": "m",
        "legend": {meaning: "#{:02x}{:02x}{:02x}".format(*rgb) for meaning, rgb in scene.legend},
    }
    if scene.motion is not None and len(scene.motion.times_s) > 1:
        data = _animate(tree, data, scene.motion)
    return _joined(tree, data)


def _as_trimesh(scene: Scene) -> Any:
    import trimesh

    made: Any = trimesh.Scene(base_frame="world")
    made.graph.update(ROOT, "world", matrix=scene.y_up_T_scene)
    for node in scene.nodes:
        made.add_geometry(
            _mesh(node),
            node_name=node.name,
            geom_name=node.name,
            parent_node_name=ROOT,
            transform=node.scene_T_node,
        )
    return made


def _mesh(node: Node) -> Any:
    import trimesh

    shape = node.shape
    mesh: Any = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    one = shape.colours.ndim == 1
    rgb = shape.colours if one else np.full(3, 255, dtype=np.uint8)
    visual: Any = trimesh.visual
    material = visual.material.PBRMaterial(
        name=node.name,
        baseColorFactor=[*_linear(rgb), round(255 * shape.opacity)],
        metallicFactor=0.0,
        roughnessFactor=_ROUGHNESS,
        alphaMode="OPAQUE" if shape.opacity == 1 else "BLEND",
        doubleSided=True,
    )
    # A vertex of no face, or of faces without an area, has no normal, which glTF does not allow.
    normals = np.array(mesh.vertex_normals)
    normals[~(np.linalg.norm(normals, axis=1) > _LEAST)] = (0.0, 0.0, 1.0)
    mesh.vertex_normals = normals
    mesh.visual = visual.TextureVisuals(material=material)
    if not one:
        linear = np.concatenate(
            [_linear(shape.colours), np.full((len(shape.colours), 1), 255, dtype=np.uint8)], axis=1
        )
        mesh.visual.vertex_attributes["color"] = linear
    return mesh


def _linear(rgb: ndarray) -> ndarray:
    """Return sRGB colours as linear ones, which glTF has."""
    share = np.asarray(rgb, dtype=np.float64) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.round(255 * linear).astype(np.uint8)


def _place(node: dict[str, Any]) -> None:
    """Write a node's pose as translation and rotation: a node that moves has no matrix."""
    matrix = np.array(node.pop("matrix", np.eye(4).T.reshape(-1)), dtype=np.float64)
    pose = matrix.reshape(4, 4).T
    if not np.allclose(pose, np.eye(4), atol=0):
        node["translation"] = [float(x) for x in pose[:3, 3]]
        node["rotation"] = [float(x) for x in _xyzw(pose[:3, :3])]


def _name_targets(tree: dict[str, Any], primitive: Mapping[str, Any]) -> None:
    """Say which data are vertices and which are indices."""
    targets = dict.fromkeys(primitive["attributes"].values(), _ARRAY)
    for number, target in {**targets, primitive["indices"]: _INDICES}.items():
        tree["bufferViews"][tree["accessors"][number]["bufferView"]]["target"] = target


def _xyzw(rotation: ndarray) -> ndarray:
    """Return quaternions in glTF's order, of unit length in 32 bits."""
    xyzw = np.roll(quaternion(rotation), -1, axis=-1)
    return xyzw / np.linalg.norm(xyzw, axis=-1, keepdims=True)


def _animate(tree: dict[str, Any], data: bytes, motion: Motion) -> bytes:
    """Add a motion to the JSON as an animation; return the data with its times and poses."""
    numbers = {node["name"]: i for i, node in enumerate(tree["nodes"])}
    parts = [data]

    def accessor(values: ndarray, kind: str) -> int:
        values = np.ascontiguousarray(values, dtype="<f4")
        start = sum(map(len, parts))
        tree["bufferViews"].append({"buffer": 0, "byteOffset": start, "byteLength": values.nbytes})
        parts.append(values.tobytes())
        entry = {
            "bufferView": len(tree["bufferViews"]) - 1,
            "componentType": _FLOAT,
            "count": len(values),
            "type": kind,
        }
        if kind == "SCALAR":
            entry |= {"min": [float(values.min())], "max": [float(values.max())]}
        tree["accessors"].append(entry)
        return len(tree["accessors"]) - 1

    times = accessor(motion.times_s, "SCALAR")
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    for name, poses in motion.scene_T_node.items():
        turned = _continuous(_xyzw(poses[:, :3, :3]))
        for path, values, kind in (
            ("translation", poses[:, :3, 3], "VEC3"),
            ("rotation", turned, "VEC4"),
        ):
            samplers.append(
                {"input": times, "output": accessor(values, kind), "interpolation": "LINEAR"}
            )
            target = {"node": numbers[name], "path": path}
            channels.append({"sampler": len(samplers) - 1, "target": target})
    tree["animations"] = [
        {
            "name": "trial",
            "samplers": samplers,
            "channels": channels,
            "extras": {"phases": _phases(motion)},
        }
    ]
    joined = b"".join(parts)
    tree["buffers"][0]["byteLength"] = len(joined)
    return joined


def _continuous(xyzw: Float[ndarray, "t 4"]) -> Float[ndarray, "t 4"]:
    """Return the quaternions with signs such that each is next to the one before."""
    flips = np.sign(np.einsum("ti,ti->t", xyzw[1:], xyzw[:-1]))
    signs = np.cumprod(np.concatenate([[1.0], np.where(flips < 0, -1.0, 1.0)]))
    return np.asarray(xyzw * signs[:, None])


def _phases(motion: Motion) -> Mapping[str, float]:
    """Return when each phase begins, seconds."""
    began: dict[str, float] = {}
    for caption, time in zip(motion.captions, motion.times_s.tolist(), strict=True):
        began.setdefault(caption, round(time, 3))
    return began


def _split(content: bytes) -> tuple[dict[str, Any], bytes]:
    """Return the JSON and the data of binary glTF."""
    length = struct.unpack_from("<I", content, 12)[0]
    tree = json.loads(content[20 : 20 + length])
    return tree, content[20 + length + 8 :]


def _joined(tree: Mapping[str, Any], data: bytes) -> bytes:
    """Return binary glTF: a header, the JSON, the data; each a multiple of four bytes."""
    text = json.dumps(tree, separators=(",", ":"), allow_nan=False, ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    return b"".join(
        (
            struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data)),
            struct.pack("<II", len(text), _JSON),
            text,
            struct.pack("<II", len(data), _BIN),
            data,
        )
    )
