"""The figure of a grasp's tolerance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from graspcast.rendering.trials.tolerance_figure import save_tolerance_figure
from graspcast.simulation.grasps.fall_off import Bounds
from graspcast.simulation.grasps.tolerance import AXES, Reach, Tolerance
from graspcast.simulation.objects.types import Grasp


def tolerance(size: float) -> Tolerance:
    reach = Bounds(size, 0.9 * size, 1.1 * size)
    reaches = [
        Reach(kind, axis, sign, reach, Bounds(1.2 * size, size, 1.3 * size), limit, 24)
        for kind, limit in (("shift", 0.1), ("turn", 1.57))
        for axis in AXES
        for sign in (-1, 1)
    ]
    scale = Bounds(2.0, 1.0, 3.0)
    grasp = Grasp(np.eye(4), "cube", "parallel")
    return Tolerance(grasp, 24, 24, tuple(reaches), (reach,) * 6, np.eye(6), scale, scale, 400)


def greens(path: Path) -> int:
    with Image.open(path) as image:
        red, green, blue = np.moveaxis(np.asarray(image.convert("RGB")).astype(int), -1, 0)
    return int(((green > red + 50) & (green > blue + 25)).sum())


def test_longer_reaches_are_longer_bars(tmp_path: Path) -> None:
    for name, size in (("short.png", 0.013), ("long.png", 0.016)):
        save_tolerance_figure(tmp_path / name, tolerance(size))
    # Both on axes of 20 mm, and of 2 degrees.
    assert 1.1 < greens(tmp_path / "long.png") / greens(tmp_path / "short.png") < 1.4


def test_what_has_no_end_is_drawn_to_the_edge(tmp_path: Path) -> None:
    save_tolerance_figure(tmp_path / "all.png", tolerance(1.5))
    assert greens(tmp_path / "all.png") > 20_000
