"""Rendered datasets: reproducibility, the BOP layout, bad input."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from graspcast.bop.dataset import BopDataset, read_targets
from graspcast.errors import InputError, UnknownNameError
from graspcast.pose.transforms import transform_points
from graspcast.rendering.synthetic.camera import INTRINSICS
from graspcast.rendering.synthetic.dataset import RenderSettings, read_models, render_dataset


def digests(root: Path) -> dict[str, str]:
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }


@pytest.mark.slow
def test_the_same_seed_the_same_files_and_more_scenes_leave_the_first_alone(
    models: Path, tmp_path: Path
) -> None:
    one = render_dataset(models, tmp_path / "one", RenderSettings(scenes=1, images=2, seed=3))
    again = render_dataset(models, tmp_path / "again", RenderSettings(scenes=1, images=2, seed=3))
    more = render_dataset(models, tmp_path / "more", RenderSettings(scenes=2, images=2, seed=3))
    other = render_dataset(models, tmp_path / "other", RenderSettings(scenes=1, images=2, seed=4))
    assert digests(one) == digests(again)
    assert digests(one / "test" / "000001") == digests(more / "test" / "000001")
    assert digests(one / "test" / "000001") != digests(other / "test" / "000001")


@pytest.mark.slow
def test_our_own_reader_reads_all_of_it(models: Path, tmp_path: Path) -> None:
    settings = RenderSettings(scenes=2, images=2, seed=1, image_format="png")
    root = render_dataset(models, tmp_path / "made", settings, obj_ids=[1, 7])
    dataset = BopDataset(root)
    truth = dataset.ground_truth
    assert set(truth.obj_id.tolist()) <= {1, 7} and len(truth) >= 4
    assert sorted(dataset.images) == [(1, 0), (1, 1), (2, 0), (2, 1)]
    assert dataset.image(2, 1).shape == (480, 640, 3)
    np.testing.assert_allclose(dataset.camera_of(1, 0).K, INTRINSICS)
    assert ((truth.visib_fract >= 0) & (truth.visib_fract <= 1)).all()
    targets = {
        (t.scene_id, t.im_id, t.obj_id) for t in read_targets(root / "test_targets_bop19.json")
    }
    rows = zip(truth.scene_id, truth.im_id, truth.obj_id, truth.visib_fract, strict=True)
    assert targets == {(s, i, o) for s, i, o, share in rows if share >= 0.1}
    assert dataset.models.mesh(7).vertices.shape == read_models(models)[7].vertices.shape
    # The box spans the projected mesh (another route than the silhouette that it was made from).
    assert truth.box_xywh is not None
    for k in range(len(truth)):
        points = dataset.models.mesh(int(truth.obj_id[k])).vertices
        pixels = transform_points(truth.cam_T_obj[k], points) @ INTRINSICS.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        x, y, width, height = truth.box_xywh[k]
        spans = [x - 0.5, y - 0.5, x + width - 0.5, y + height - 0.5]
        wanted = [*pixels.min(axis=0), *pixels.max(axis=0)]
        np.testing.assert_allclose(spans, wanted, atol=1.2)
    made = json.loads((root / "render.json").read_text())
    assert made["settings"]["seed"] == 1 and "mujoco" in made["versions"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scenes": 0}, "at least one"),
        ({"images": -1}, "at least one"),
        ({"image_format": "bmp"}, "jpg, png, webp"),
        ({"quality": 101}, "1 to 100"),
        ({"seed": -1}, "0 or more"),
    ],
)
def test_settings_that_make_no_sense(changes: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        RenderSettings(**changes)  # type: ignore[arg-type]


def test_unknown_objects_are_refused(models: Path, tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="unknown object '2'; known: 1, 4, 7"):
        render_dataset(models, tmp_path / "a", obj_ids=[2])
    assert list(tmp_path.iterdir()) == []
