"""Every variant of file that the docs list is read, and gives what the usual one gives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import file_variants
from bop_images import FOCAL, SIZE, write_dataset
from file_variants import BOXES, DATASETS, DETECTIONS, IMAGES, MODELS, NAMES, RESULTS, Variant
from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import read_detections
from graspcast.bop.file_names import belongs_to, split_in
from graspcast.bop.meshes import read_coloured_mesh
from graspcast.bop.models import Models
from graspcast.bop.results import read_results


def estimates(path: Path, given: dict[str, Any]) -> None:
    found, expected = read_results(path, **given), file_variants.poses()
    expected = expected.select(np.arange(len(found)))
    assert 1 <= len(found) <= 2
    assert_allclose(found.cam_T_obj, expected.cam_T_obj, atol=1e-9)
    for name in ("scene_id", "im_id", "obj_id"):
        assert_array_equal(getattr(found, name), getattr(expected, name))


def names(path: Path, given: dict[str, Any]) -> None:
    dataset = given["dataset"]
    assert belongs_to(path, [dataset, "another"]) == (dataset, True)
    assert split_in(path, dataset) == given["split"]


def detections(path: Path, given: dict[str, Any]) -> None:
    found = read_detections(path, **given)
    rows = zip(found.scene_id, found.im_id, found.obj_id, found.box_xywh.tolist(), strict=True)
    assert [(*map(int, row[:3]), row[3]) for row in rows] == [tuple(box) for box in BOXES]


def directory(path: Path, given: dict[str, Any]) -> None:
    usual = write_dataset(path.parent / "usual")
    how = {name: given[name] for name in ("split", "sensor") if name in given}
    dataset = BopDataset(path, **how)
    truth, expected = dataset.ground_truth, usual.ground_truth
    assert_array_equal(truth.cam_T_obj, expected.cam_T_obj)
    assert_array_equal(truth.obj_id, expected.obj_id)
    if given.get("without") != "visibility":
        assert_array_equal(truth.visib_fract, expected.visib_fract)
    assert dataset.image_size == (None if given.get("without") == "size" else SIZE)
    scale = given.get("scale", 1)
    assert list(dataset.images) == list(usual.images)
    for key in usual.images:
        assert dataset.camera_of(*key).K[0, 0] == scale * FOCAL
        assert dataset.image(*key).shape == (scale * SIZE[1], scale * SIZE[0], 3)
    assert sorted(dataset.models.info) == [1, 5]


def images(path: Path, given: dict[str, Any]) -> None:
    directory(path, given)
    usual, dataset = write_dataset(path.parent / "again"), BopDataset(path)
    found, expected = dataset.image(1, 3), usual.image(1, 3)
    if dataset.images[1, 3].suffix == ".jpg" or given.get("scale"):
        return  # other pixels
    if "gray" in dataset.images[1, 3].parent.name:
        assert (found[..., 0] == found[..., 2]).all()
        assert abs(found[..., 0].astype(float) - expected.mean(axis=2)).mean() < 30
    elif dataset.images[1, 3].suffix != ".webp":
        assert_array_equal(found, expected)


def models(path: Path, given: dict[str, Any]) -> None:
    read = Models(path)
    assert_allclose(read[1].size, [0.04, 0.06, 0.1])
    assert_allclose(read[1].lower, [-0.02, -0.03, -0.05])
    assert read[1].symmetric is given.get("symmetric", False)
    mesh = read.mesh(1)
    assert_allclose(np.ptp(mesh.vertices, axis=0), [0.04, 0.06, 0.1])
    assert len(mesh.faces) == 12 and mesh.stray == 0
    if "colour" in given:
        _, colours = read_coloured_mesh(path / "obj_000001.ply")
        assert (colours[:, 0] == given["colour"]).all()


CHECKS = {
    RESULTS: estimates,
    NAMES: names,
    DETECTIONS: detections,
    DATASETS: directory,
    IMAGES: images,
    MODELS: models,
}


@pytest.mark.parametrize("variant", file_variants.VARIANTS, ids=lambda v: f"{v.kind}: {v.what}")
def test_a_variant_is_read(variant: Variant, tmp_path: Path) -> None:
    CHECKS[variant.kind](variant.make(tmp_path), dict(variant.given))


def test_the_docs_list_every_variant_and_no_other() -> None:
    text = file_variants.DOCS.read_text(encoding="utf-8")
    assert file_variants.page(text) == text, "run: python tests/file_variants.py"
