"""Datasets with detections, and another virtual environment."""

from __future__ import annotations

from pathlib import Path

import pytest

from bop_images import write_dataset
from crude import make_python
from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections, jittered, read_detections, write_detections
from graspcast.demo_data import demo_dataset


@pytest.fixture(scope="session")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of another virtual environment, which has no package at all."""
    return make_python(tmp_path_factory.mktemp("other env"))


@pytest.fixture
def dataset(tmp_path: Path) -> BopDataset:
    return write_dataset(tmp_path / "made")


@pytest.fixture
def boxes(dataset: BopDataset, tmp_path: Path) -> Path:
    path = tmp_path / "my boxes.json"
    write_detections(path, jittered(dataset, 0))
    return path


@pytest.fixture(scope="session")
def demo() -> BopDataset:
    """The demonstration dataset."""
    return demo_dataset()


@pytest.fixture(scope="session")
def demo_boxes(demo: BopDataset) -> Detections:
    return read_detections(demo.root / "test_detections_jittered.json", demo)
