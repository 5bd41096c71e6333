"""URDF of a hand, read into a MuJoCo specification."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from graspcast.errors import FormatError
from graspcast.io.reading import MAX_TEXT_BYTES, check_regular, read_text
from graspcast.simulation.mujoco_messages import one_line, quiet_mujoco

__all__ = ["read_urdf"]

_MESHES = (".stl", ".obj", ".msh")
_PREFIX = re.compile(r"<(/?)([A-Za-z_][\w.-]*):")
"""Prefix of an element of another program, often of a namespace that is not declared."""
_UP = 5
"""How many folders above the URDF a package is searched in."""


def read_urdf(path: Path) -> Any:
    """Read a URDF into an ``MjSpec`` whose links are bodies, also those on fixed joints.

    Meshes are found beside the file, or by ``package://``, whose package is a folder at or above
    that of the file, or beside one of these. Visual meshes that MuJoCo does not read, or that are
    not there, are left out.

    Raises
    ------
    FormatError
        If it is not URDF that MuJoCo reads, or a mesh of a collision shape is not found or of
        another format.
    """
    from graspcast.simulation.engine import mujoco

    text = read_text(path, MAX_TEXT_BYTES)
    if "<xacro:" in text:  # the declaration of the namespace is left in what xacro writes
        raise FormatError(
            path, "is a xacro file; expand it first: xacro hand.urdf.xacro > hand.urdf"
        )
    try:
        robot = ElementTree.fromstring(_PREFIX.sub(r"<\1\2_", text))
    except (ElementTree.ParseError, ValueError) as error:
        raise FormatError(path, f"is not XML ({error})") from error
    if robot.tag != "robot":
        raise FormatError(path, f"is not URDF: its root element is <{robot.tag}>, not <robot>")
    for link in robot.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            _resolve(path, link, shape)
    extension = robot.find("mujoco")
    if extension is None:
        extension = ElementTree.SubElement(robot, "mujoco")
    compiler = extension.find("compiler")
    if compiler is None:
        compiler = ElementTree.SubElement(extension, "compiler")
    compiler.attrib.pop("meshdir", None)
    compiler.set("strippath", "false")
    compiler.set("fusestatic", "false")
    compiler.set("discardvisual", "false")
    quiet_mujoco()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, encoding="unicode"))
    except (ValueError, TypeError, RuntimeError) as error:
        raise FormatError(path, f"is not URDF that MuJoCo reads: {one_line(error)}") from error
    return spec


def _resolve(path: Path, link: Any, shape: Any) -> None:
    """Replace a shape's mesh by the path of its file; remove a visual one that cannot be read."""
    mesh = shape.find("geometry/mesh")
    if mesh is None:
        return
    name = mesh.get("filename", "")
    found = _find(path, name)
    readable = found is not None and found.suffix.lower() in _MESHES
    if shape.tag == "visual" and not readable:
        link.remove(shape)
        return
    where = f"link {link.get('name')!r}"
    if found is None:
        raise FormatError(
            path, f"names the mesh {name!r}, which is not found beside it or above", where=where
        )
    if not readable:
        raise FormatError(
            path,
            f"has the collision mesh {name!r}, and MuJoCo reads {', '.join(_MESHES)}: convert it "
            "(trimesh and MeshLab do)",
            where=where,
        )
    check_regular(found)
    mesh.set("filename", str(found.resolve()))


def _find(path: Path, name: str) -> Path | None:
    """Return the file of a mesh, or None."""
    scheme, _, rest = name.rpartition("://")
    folder = path.resolve().parent
    if scheme == "package":
        above = [folder, *folder.parents[:_UP]]
        inside = rest.partition("/")[2]
        candidates = [f / part for f in above for part in (rest, inside) if part]
    else:
        candidates = [folder / rest]
    return next((file for file in candidates if file.is_file()), None)
