"""Estimates from two images and the fused pose: the sheet, its errors, and when there is none."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.demo_data import demo_dataset
from graspcast.errors import InputError
from graspcast.rendering import two_sides
from graspcast.rendering.fused_sides import draw_fused

SCENE, OBJECT = 1, 2


def results(dataset: BopDataset, seed: int, images: int = 6) -> Results:
    """The true poses, wrong by much along the ray and by little across it."""
    truth = dataset.ground_truth
    rows = (truth.scene_id == SCENE) & (truth.im_id < images)
    pose, n = truth.cam_T_obj[rows].copy(), int(rows.sum())
    rng = np.random.default_rng(seed)
    pose[:, :3, 3] *= 1 + rng.normal(0, 0.012, size=(n, 1))
    return Results(
        scene_id=truth.scene_id[rows],
        im_id=truth.im_id[rows],
        obj_id=truth.obj_id[rows],
        score=np.ones(n),
        cam_T_obj=pose,
        time_s=np.full(n, -1.0),
        line=np.arange(n),
        source=f"made {seed}",
    )


def test_what_is_written_and_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = demo_dataset()
    tables = {name: results(dataset, seed) for seed, name in enumerate(("a", "b"))}
    said: list[str] = []
    monkeypatch.setattr(two_sides, "write", lambda draw, at, text, *rest: said.append(text))
    sheet = draw_fused(dataset, tables, SCENE, 0, OBJECT, principal="a", size=160)
    assert sheet is not None and sheet.width == 330
    titles, legend = said[:2], said[2:]
    assert titles[0] == f"ycbv-{OBJECT} in image {SCENE}/0" and titles[0] != titles[1]
    assert [text.split(":")[0] for text in legend[:2]] == [
        "a, left image alone",
        "a, right image alone",
    ]
    assert legend[2].startswith("fused from 3 images, two shown: ")
    assert legend[2].endswith("mm off")
    truth = dataset.ground_truth
    row = np.flatnonzero((truth.scene_id == SCENE) & (truth.im_id == 0) & (truth.obj_id == OBJECT))
    off = 1000 * np.linalg.norm(
        tables["a"].cam_T_obj[row[0], :3, 3] - truth.cam_T_obj[row[0], :3, 3]
    )
    assert legend[0].endswith(f": {off:.0f} mm off")


def test_no_other_view_is_no_sheet() -> None:
    dataset = demo_dataset()
    tables = {"a": results(dataset, 0, images=6)}
    one = {"a": tables["a"].select(tables["a"].im_id == 0)}
    assert draw_fused(dataset, one, SCENE, 0, OBJECT, principal="a") is None
    with pytest.raises(InputError, match="no estimate of object 99"):
        draw_fused(dataset, tables, SCENE, 0, 99, principal="a")
