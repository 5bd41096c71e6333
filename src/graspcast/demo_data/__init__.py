"""Rendered tables that ship (see ``README.md`` here): the demonstration needs no network."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from graspcast.bop.dataset import BopDataset

__all__ = ["demo_dataset"]


def demo_dataset() -> BopDataset:
    """300 images of 30 tables with six objects, for which the built-in estimators are trained.

    ``test_detections_jittered.json`` in its directory says where the objects are.
    """
    return BopDataset(Path(str(files(__name__))) / "ycbv")
