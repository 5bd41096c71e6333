"""A dataset with estimates and verdicts to be drawn as overlays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bop_images import estimates_of, write_dataset
from graspcast.bop.results import write_results
from graspcast.estimates.instances import InstanceKey
from graspcast.forecasting.verdict import VerdictRow, decide


def written(pixels: np.ndarray, colour: tuple[int, int, int]) -> int:
    """How many pixels are nearly of the colour of an ink."""
    return int((np.abs(pixels.astype(int) - colour).max(axis=-1) < 45).sum())


def write_estimates(tmp_path: Path) -> Path:
    """Write a dataset with images, and estimates of it by a and b."""
    dataset = write_dataset(tmp_path / "made")
    for seed, name in enumerate("ab"):
        write_results(tmp_path / f"{name}_made-test.csv", estimates_of(dataset, seed))
    return tmp_path


def verdict_row(
    scene_id: int,
    im_id: int,
    obj_id: int,
    est_id: int = 0,
    *,
    probability: float,
    cam_T_obj: np.ndarray | None = None,
) -> VerdictRow:
    pose = np.eye(4) if cam_T_obj is None else cam_T_obj
    key = InstanceKey("made", scene_id, im_id, obj_id, est_id)
    return VerdictRow(key, "a", "parallel", decide(probability, 0.5), pose)
