"""Training samples: what a crop stores agrees with its pose; rendering goes on where it stopped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from graspcast.errors import FormatError
from graspcast.pose.transforms import transform_points
from graspcast.rendering.synthetic.camera import INTRINSICS as K
from graspcast.rendering.synthetic.camera import random_view
from graspcast.training import samples as module
from graspcast.training.objects import Objects
from graspcast.training.samples import STORED_CELLS, Samples, render_samples


@pytest.fixture(scope="module")
def directory(solids: Objects, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("work") / "samples"
    render_samples(directory, solids, seed=3, images=16)
    return directory


def test_coordinates_project_to_their_cells(directory: Path, solids: Objects) -> None:
    samples = Samples(directory)
    assert len(samples) > 10
    found = samples.take(np.arange(len(samples)))
    for k in range(0, len(samples), 5):
        mask = found["mask"][k]
        assert mask.any()
        info = solids.models[solids.ids[found["object"][k]]]
        points = info.lower + found["coordinates"][k][mask] / 255 * info.size
        pixels = transform_points(found["cam_T_obj"][k], points) @ K.T
        u, v, side = found["crop"][k]
        place = (pixels[:, :2] / pixels[:, 2:] - [u, v]) / side
        row, column = np.nonzero(mask)
        cells = (np.stack([column, row], axis=-1) + 0.5) / STORED_CELLS - 0.5
        # A cell, and the precision of eight bits.
        assert np.abs(place - cells).max() < 1.5 / STORED_CELLS


@pytest.mark.slow
def test_rendering_goes_on_where_it_stopped(
    directory: Path, solids: Objects, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LAYOUTS", 1)
    said: list[str] = []

    def stop(share: float, message: str) -> None:
        said.append(message)
        if share > 0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_samples(tmp_path, solids, seed=3, images=20, progress=stop)
    assert [p.name for p in tmp_path.iterdir()] == ["00000.npz"]
    before = (tmp_path / "00000.npz").read_bytes()
    render_samples(tmp_path, solids, seed=3, images=20)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["00000.npz", "00001.npz"]
    assert (tmp_path / "00000.npz").read_bytes() == before
    assert said == ["0 of 2 files of training images", "1 of 2 files of training images"]
    # The first file is the one of the other directory: it depends on seed and number alone.
    first, other = Samples(directory).columns, Samples(tmp_path).columns
    np.testing.assert_array_equal(first["image"][0], other["image"][0])


def test_no_scene_is_one_that_render_makes() -> None:
    # Seeds that differ in trailing zeros alone are the same to NumPy.
    def view(*seed: int) -> np.ndarray:
        return random_view(np.random.default_rng(seed), np.zeros(3)).sim_T_cam

    np.testing.assert_array_equal(view(1, 2), view(1, 2, 0))
    assert not np.allclose(view(1, 2), view(1, 2, 0, module._TRAINING))


def test_damaged_files_are_named(directory: Path, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="holds no training samples"):
        Samples(tmp_path)
    content = (directory / "00000.npz").read_bytes()
    (tmp_path / "00000.npz").write_bytes(content[: len(content) // 2])
    with pytest.raises(FormatError, match=r"00000\.npz.*delete it to render it again"):
        Samples(tmp_path)
