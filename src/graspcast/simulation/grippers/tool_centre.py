"""Tool centre point of a hand in a TOML file: a site of its model, or a pose."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import FormatError, UnknownNameError
from graspcast.io.toml import TomlTable
from graspcast.pose.lengths import Reference, shown, unit_problem
from graspcast.pose.transforms import rotation_from_quaternion, transform
from graspcast.simulation.grippers.dimensions import hand_size_m

__all__ = ["read_tcp"]

_KEYS = ("tcp_site", "tcp_position_m", "tcp_quaternion", "tcp_body")


def read_tcp(path: Path, table: TomlTable, compiled: Any) -> Float[ndarray, "4 4"]:
    """Return the tool centre point in the frame of the hand's base, the root body.

    Parameters
    ----------
    path
        The TOML file.
    table
        Its table, with ``tcp_site``; or with ``tcp_position_m`` and ``tcp_quaternion`` (wxyz), in
        the frame of ``tcp_body``, by default the base; or with ``tcp_body`` alone, for its frame.
    compiled
        The compiled hand.

    Raises
    ------
    FormatError
        If both or neither are given, or the point is nowhere near the hand.
    UnknownNameError
        If the model lacks the site or the body.
    """
    from graspcast.simulation.engine import mujoco

    given = [key for key in _KEYS if key in table.values]
    data = mujoco.MjData(compiled)
    mujoco.mj_kinematics(compiled, data)
    if not given or ("tcp_site" in given and len(given) > 1):
        raise FormatError(
            path,
            "needs either tcp_site, or tcp_position_m and tcp_quaternion (and tcp_body, if they "
            f"are not in the base's frame) for the tool centre point; it has {given or 'neither'}",
        )
    if "tcp_site" in given:
        site = table.take("tcp_site", str)
        names = [compiled.site(i).name for i in range(compiled.nsite)]
        if site not in names:
            raise UnknownNameError(
                "site",
                site,
                names,
                hint=f"{path} names it as tcp_site; a pose in the TOML (tcp_position_m, "
                "tcp_quaternion) needs no site.",
            )
        found = data.site(site)
        base_T_tcp = _in_base(data, found)
    else:
        base_T_tcp = _in_base(data, _body(path, table, compiled, data)) @ _pose(table)
    size = hand_size_m(compiled)
    distance = float(np.linalg.norm(base_T_tcp[:3, 3]))
    near = Reference(f"the hand is {shown(size)} across", 0.0, 2.5 * size, (0.1 * size, 1.5 * size))
    if problem := unit_problem("the tool centre point's distance from the base", distance, near):
        raise FormatError(path, f"{problem} (see {given[0]})")
    return base_T_tcp


def _in_base(data: Any, element: Any) -> Float[ndarray, "4 4"]:
    """Return the pose of a site or body in the base's frame."""
    base = data.xmat[1].reshape(3, 3)  # 0 is the world
    rotation = base.T @ element.xmat.reshape(3, 3)
    return transform(rotation, base.T @ (element.xpos - data.xpos[1]))


def _body(path: Path, table: TomlTable, compiled: Any, data: Any) -> Any:
    """Return the body in whose frame the pose is."""
    if "tcp_body" not in table.values:
        return data.body(1)
    name = table.take("tcp_body", str)
    names = [compiled.body(i).name for i in range(1, compiled.nbody)]
    if name not in names:
        raise UnknownNameError("body", name, names, hint=f"{path} names it as tcp_body.")
    if compiled.body(name).weldid[0] != compiled.body(1).weldid[0]:
        raise table.error("tcp_body", f"is {name!r}, which moves as the hand closes")
    return data.body(name)


def _pose(table: TomlTable) -> Float[ndarray, "4 4"]:
    """Return the pose that the table gives; of a body alone, its own."""
    alone = "tcp_position_m" not in table.values and "tcp_quaternion" not in table.values
    position = np.zeros(3) if alone else np.array(table.numbers("tcp_position_m", 3))
    wxyz = np.array([1.0, 0, 0, 0]) if alone else np.array(table.numbers("tcp_quaternion", 4))
    length = float(np.linalg.norm(wxyz))
    if abs(length - 1) > 1e-3:
        raise table.error("tcp_quaternion", f"has length {length:.4g}, not 1 (it is w, x, y, z)")
    return transform(rotation_from_quaternion(wxyz), position)
