"""Validation of trained estimators: pose errors on rendered images that were not trained on."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections, read_detections
from graspcast.estimates.error_tables import measure
from graspcast.io.progress import Progress
from graspcast.perception.estimator import built_in
from graspcast.perception.run import estimate_poses
from graspcast.rendering.synthetic.dataset import RenderSettings, render_dataset
from graspcast.training.objects import Objects

__all__ = ["ERRORS", "in_words", "measure_errors", "validation_images"]

ERRORS = ("rotation_deg_50", "rotation_deg_90", "translation_mm_50", "translation_mm_90")
"""Median and 90 % quantile of rotation errors, degrees, and of translation errors, millimetres."""

_VIEWS = 8
_SEEDS_APART = 7_000_000


def validation_images(
    directory: str | PathLike[str],
    objects: Objects,
    *,
    images: int,
    seed: int,
    progress: Progress | None = None,
) -> BopDataset:
    """Render a BOP dataset of validation images, unless it is there.

    Parameters
    ----------
    directory
        The directory of the dataset.
    objects
        The objects.
    images
        Number of images, rounded up to a multiple of 8, the views of one table.
    seed
        Seed of training; that of these images is another.
    progress
        Called with the share of images done, and the next.
    """
    directory = Path(directory)
    if not (directory / "render.json").is_file():
        settings = RenderSettings(-(-images // _VIEWS), _VIEWS, _SEEDS_APART + seed)
        models = objects.models.directory
        render_dataset(models, directory, settings, obj_ids=objects.ids, progress=progress)
    return BopDataset(directory, name=objects.dataset)


def measure_errors(
    name: str,
    weights: str | PathLike[str],
    dataset: BopDataset,
    detections: str | PathLike[str],
    *,
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """Run an estimator on detections, and compare its poses with the true ones.

    Parameters
    ----------
    name
        The estimator.
    weights
        Its ONNX file.
    dataset
        Images and ground truth.
    detections
        The detections file.
    progress
        Called with the share of images done.

    Returns
    -------
        For each object, and at last for all together (``obj_id`` None): ``detections``, ``poses``
        (where something was found), and :data:`ERRORS`, None without a pose.
    """
    seen = read_detections(detections, dataset)
    results = estimate_poses(built_in(name, weights), dataset, seen, progress)
    # Where nothing at all was found there is nothing to measure.
    only = ("rotation_deg", "translation_mm")
    errors = measure(results, dataset, only=only, plausible=False) if len(results) else None
    return [_row(seen, errors, obj_id) for obj_id in (*np.unique(seen.obj_id).tolist(), None)]


def _row(seen: Detections, errors: pl.DataFrame | None, obj_id: int | None) -> dict[str, Any]:
    mine = len(seen) if obj_id is None else int((seen.obj_id == obj_id).sum())
    found = errors
    if found is not None and obj_id is not None:
        found = found.filter(pl.col("obj_id") == obj_id)
    row: dict[str, Any] = {"obj_id": obj_id, "detections": mine, "poses": 0}
    row |= dict.fromkeys(ERRORS)
    if found is None or not len(found):
        return row
    row["poses"] = len(found)
    for key in ERRORS:
        column, _, quantile = key.rpartition("_")
        value = found[column].quantile(int(quantile) / 100, "linear")
        row[key] = None if value is None else round(float(value), 2)
    return row


def in_words(rows: Sequence[dict[str, Any]], dataset: str) -> list[list[str]]:
    """Return rows of a table in words: object, poses of detections, and four errors."""
    out = []
    for row in rows:
        name = "all" if row["obj_id"] is None else f"{dataset}-{row['obj_id']}"
        cells = ["-" if row[key] is None else f"{row[key]:.1f}" for key in ERRORS]
        out.append([name, f"{row['poses']} of {row['detections']}", *cells])
    return out
