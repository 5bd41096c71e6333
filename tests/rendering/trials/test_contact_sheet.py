from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cubes import orange
from graspcast.cli import main
from graspcast.rendering.trials.renderer import SceneRenderer


def test_the_contact_sheet_has_a_field_for_each_pair(
    tmp_path: Path, tables: list[str], renderer: SceneRenderer, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "sheet.png"
    command = ["grasps", *tables, "--objects", "cube", "lmo-5", "--size", "100", "--out", str(out)]
    assert main(command) == 0
    said = capsys.readouterr().out
    for line in ("cube by parallel", "cube by underactuated", "lmo-5 by parallel"):
        assert line in said
    assert "held" in said and said.count("no reference grasp") + said.count("no mesh") == 3
    with Image.open(out) as image:
        pixels = np.asarray(image.convert("RGB"))
    left, right = np.array_split(pixels[:, 40:], 2, axis=1)
    (top, below), (other, _) = (np.array_split(part, 2, axis=0) for part in (left, right))
    assert orange(top) > 200
    assert orange(below) == orange(other) == 0
