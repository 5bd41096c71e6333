"""Models with colours: which file is read, how often, and what cannot be drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from graspcast.bop.dataset import BopDataset
from graspcast.errors import FormatError, UnknownNameError
from graspcast.rendering.coloured_models import ColouredModels
from overlays import write_estimates


def test_models_are_in_metres_and_read_once(tmp_path: Path) -> None:
    dataset = BopDataset(write_estimates(tmp_path) / "made")
    models = ColouredModels(dataset)
    mesh, colours = models[5]
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), (0.04, 0.06, 0.1))
    assert colours.shape == mesh.vertices.shape
    assert models[5][0] is mesh
    with pytest.raises(UnknownNameError, match="7"):
        models[7]


def test_points_alone_cannot_be_drawn(tmp_path: Path) -> None:
    dataset = BopDataset(write_estimates(tmp_path) / "made")
    path = dataset.root / "models" / "obj_000001.ply"
    lines = path.read_text().replace("element face 2", "element face 0").splitlines()
    path.write_text("\n".join(lines[:-2]) + "\n")
    with pytest.raises(FormatError, match="no faces"):
        ColouredModels(dataset)[1]
