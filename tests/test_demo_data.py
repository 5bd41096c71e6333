"""The demonstration dataset in the package."""

from __future__ import annotations

import json

import numpy as np
import pytest

from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import jittered, read_detections
from graspcast.demo_data import demo_dataset


@pytest.fixture(scope="module")
def dataset() -> BopDataset:
    return demo_dataset()


def test_the_boxes_that_ship_are_those_that_render_writes(
    dataset: BopDataset,
) -> None:
    boxes = read_detections(dataset.root / "test_detections_jittered.json", dataset)
    seed = json.loads((dataset.root / "render.json").read_text())["settings"]["seed"]
    again = jittered(dataset, seed)
    np.testing.assert_array_equal(again.box_xywh, boxes.box_xywh)
    assert "not a detector" in boxes.detector


def test_the_images_that_ship_are_small_and_many(dataset: BopDataset) -> None:
    assert sum(path.stat().st_size for path in dataset.root.rglob("*")) <= 12_000_000
    assert len(dataset.images) >= 200
    assert len({scene for scene, _ in dataset.images}) >= 20
    assert "settings" in json.loads((dataset.root / "render.json").read_text())
