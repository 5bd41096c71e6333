"""The synthetic demonstration dataset and model in the package (see ``README.md`` here)."""

from __future__ import annotations

from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from graspcast.bop.dataset import BopDataset

__all__ = ["DEMO", "demo_dataset", "demo_model", "model_path"]

DEMO = "demo"
"""The name of the demonstration's model, where a model file is asked for."""


def demo_dataset() -> BopDataset:
    """Open the demonstration dataset: 300 images of 30 tables with six YCB objects.

    The built-in estimators are trained for these objects. ``test_detections_jittered.json`` in the
    dataset's directory holds detections.
    """
    from graspcast.bop.dataset import BopDataset

    return BopDataset(Path(str(files(__name__))) / "ycbv")


def demo_model() -> Path:
    """Return the file of the demonstration's model, which forecasts grasps of its six objects.

    The estimators are the built-in ones, ``dense`` guides. ``graspcast.Watcher.load("demo")`` and
    ``graspcast predict --model demo`` take it.
    """
    return Path(str(files(__name__))) / "model.npz"


def model_path(name: str | PathLike[str]) -> Path:
    """Return the path of a model file; the text ``demo`` is the demonstration's.

    A file of that name is ``./demo``.
    """
    return demo_model() if isinstance(name, str) and name == DEMO else Path(name)
