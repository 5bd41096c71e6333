"""Contact sheets of reference grasps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from cubes import orange
from graspcast.rendering.trials.contact_sheet import draw_cells, save_sheet
from graspcast.rendering.trials.renderer import SceneRenderer
from graspcast.simulation.grasps.table import read_grasps
from graspcast.simulation.grippers import GRIPPERS, load_gripper
from graspcast.simulation.objects.catalogue import read_catalogue


def test_the_contact_sheet_has_a_field_for_each_pair(
    tmp_path: Path, tables: list[str], renderer: SceneRenderer
) -> None:
    out = tmp_path / "sheet.png"
    catalogue = read_catalogue(tmp_path / "objects.toml")
    entries = [catalogue["cube"], catalogue["lmo-5"]]
    cells = draw_cells(
        entries,
        [load_gripper(name) for name in GRIPPERS],
        read_grasps(tmp_path / "grasps.toml"),
        catalogue=catalogue,
        size=100,
    )
    assert len(cells) == 4
    held = cells["cube", "parallel"].outcome
    assert held is not None and held.success
    assert cells["cube", "underactuated"].note == "no reference grasp"
    save_sheet(out, [(e.name, e.label) for e in entries], list(GRIPPERS), cells, size=100)
    with Image.open(out) as image:
        pixels = np.asarray(image.convert("RGB"))
    left, right = np.array_split(pixels[:, 40:], 2, axis=1)
    (top, below), (other, _) = (np.array_split(part, 2, axis=0) for part in (left, right))
    assert orange(top) > 200
    assert orange(below) == orange(other) == 0
