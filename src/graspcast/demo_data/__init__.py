"""The synthetic demonstration dataset in the package, and a forecaster (see ``README.md`` here)."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from graspcast.bop.dataset import BopDataset

__all__ = ["demo_dataset", "demo_model"]


def demo_dataset() -> BopDataset:
    """Open the demonstration dataset: 300 images of 30 tables with six YCB objects.

    The built-in estimators are trained for these objects. ``test_detections_jittered.json`` in the
    dataset's directory holds detections.
    """
    return BopDataset(Path(str(files(__name__))) / "ycbv")


def demo_model() -> Path:
    """Return the path of a forecaster of grasps on these objects, by the built-in estimators."""
    return Path(str(files(__name__))) / "model.npz"
