"""A cube to be grasped, and the colours in pictures of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from graspcast.pose.transforms import transform
from graspcast.simulation.grasps.table import ReferenceGrasp, write_grasps
from graspcast.simulation.objects.types import Grasp

SIZE = 96

MISS = transform(np.eye(3), np.array([0.2, 0.0, 0.0]))

OFF = transform(np.eye(3), np.array([0.0, 0.015, 0.0]))

OBJECTS = """
[objects.cube]
label = "wooden cube"
mesh = "cube.ply"
unit = "mm"
mass_kg = 0.1
mass_source = "a test's"
friction = 0.8
friction_source = "a test's"
up = [0, 0, 1]
collision = { pieces = 1 }
"""


def green(pixels: np.ndarray) -> int:
    """How many pixels are clearly green."""
    red, mid, blue = np.moveaxis(pixels.astype(int), -1, 0)
    return int(((mid > red + 25) & (mid > blue + 25)).sum())


def orange(pixels: np.ndarray) -> int:
    red, mid, blue = np.moveaxis(pixels.astype(int), -1, 0)
    return int(((red > mid + 25) & (mid > blue + 25)).sum())


def write_tables(tmp_path: Path) -> list[str]:
    """Write a catalogue and a grasp table for a cube; return the options that name them."""
    import trimesh

    trimesh.creation.box(extents=(60, 60, 60)).export(tmp_path / "cube.ply")
    (tmp_path / "objects.toml").write_text(OBJECTS, encoding="utf-8")
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.015
    write_grasps(
        tmp_path / "grasps.toml", [ReferenceGrasp(Grasp(pose, "cube", "parallel"), "by a test")]
    )
    return [
        *("--catalogue", str(tmp_path / "objects.toml")),
        *("--grasps", str(tmp_path / "grasps.toml")),
    ]
