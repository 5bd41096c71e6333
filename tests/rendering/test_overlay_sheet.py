"""Sheets of overlays: pose errors and verdicts below each picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bop_images import IMAGES
from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import read_results
from graspcast.errors import InputError, MismatchError
from graspcast.rendering.drawing import BAD, GOOD
from graspcast.rendering.overlay_sheet import overlay_sheet, overlays
from overlays import verdict_row, write_estimates, written


@pytest.fixture
def world(tmp_path: Path) -> Path:
    return write_estimates(tmp_path)


def test_fields_tell_what_the_errors_are(world: Path) -> None:
    dataset = BopDataset(world / "made")
    results = {name: read_results(world / f"{name}_made-test.csv") for name in "ab"}
    fields = overlays(dataset, results, IMAGES, size=64)
    assert [(f.object, f.estimator) for f in fields[:4]] == [
        ("made-1", "a"), ("made-1", "b"), ("made-5", "a"), ("made-5", "b"),
    ]  # fmt: skip
    assert len(fields) == 2 * len(dataset.ground_truth)
    for field in fields:
        table = results[field.estimator]
        keys = (table.scene_id, table.im_id, table.obj_id)
        of = (field.scene_id, field.im_id, int(field.object[-1]))
        (row,) = np.flatnonzero(np.all([k == v for k, v in zip(keys, of, strict=True)], axis=0))
        true, est = dataset.ground_truth.cam_T_obj[row], table.cam_T_obj[row]
        assert field.translation_mm == pytest.approx(1000 * np.linalg.norm((est - true)[:3, 3]))
        cosine = (np.trace(est[:3, :3].T @ true[:3, :3]) - 1) / 2
        assert field.rotation_deg == pytest.approx(np.degrees(np.arccos(cosine)), rel=1e-6)


def test_without_ground_truth_there_is_the_estimate_alone(world: Path) -> None:
    dataset = BopDataset(world / "made")
    results = {"a": read_results(world / "a_made-test.csv")}
    known = overlays(dataset, results, [(1, 3)], size=64)
    for path in (world / "made").glob("test/*/scene_gt.json"):
        path.unlink()
    fields = overlays(BopDataset(world / "made"), results, [(1, 3)], size=64)
    assert [field.rotation_deg for field in fields] == [None, None]
    assert any((a.pixels != b.pixels).any() for a, b in zip(known, fields, strict=True))


def test_several_of_an_object_and_verdicts_on_each(world: Path) -> None:
    dataset = BopDataset(world / "made")
    table = read_results(world / "a_made-test.csv").select(np.array([0, 0]))
    shifted = table.cam_T_obj.copy()
    shifted[1, :3, 3] += [0.05, 0.0, 0.0]
    # The second row of the file has the higher score, so it is instance 0.
    table = replace(table, cam_T_obj=shifted, score=np.array([0.2, 0.9]))
    one = replace(table.select(np.array([1])), score=np.array([0.7]))
    verdicts = [
        verdict_row(1, 3, 1, 1, probability=0.2, cam_T_obj=table.cam_T_obj[0]),
        verdict_row(1, 3, 1, 0, probability=0.9, cam_T_obj=table.cam_T_obj[1]),
    ]
    fields = overlays(dataset, {"a": table, "b": one}, [(1, 3)], verdicts=verdicts, size=64)
    assert [field.pixels is None for field in fields] == [False, False, False, True]
    told = [[row.verdict.attempt for row in field.verdicts] for field in fields]
    assert told == [[True], [], [False], []]
    # The one true object belongs to the nearer of two estimates, or to the only one.
    assert [field.rotation_deg is None for field in fields] == [True, False, False, True]
    sheet = np.asarray(overlay_sheet(fields, estimators=2, size=64))
    # Captions that are wider than the pictures keep these apart.
    assert 4 * 64 + 3 * 8 < sheet.shape[1] < 1000
    for colour, half in ((GOOD, 0), (BAD, 1)):
        mine = np.array_split(sheet, 2, axis=1)[half]
        other = np.array_split(sheet, 2, axis=1)[1 - half]
        assert written(mine[64:], colour) > 10 and not written(other[64:], colour)
    missing = "no verdict on made-1 in image 1/3, est_id 1 by a"
    with pytest.raises(InputError, match=missing):
        overlays(dataset, {"a": table}, [(1, 3)], verdicts=verdicts[1:], size=64)
    stale = replace(table, score=table.score[::-1].copy())
    with pytest.raises(MismatchError, match="was on another pose than the one in"):
        overlays(dataset, {"a": stale}, [(1, 3)], verdicts=verdicts, size=64)
    # The principal's estimates have the verdicts, wherever it stands.
    fields = overlays(dataset, {"b": one, "a": table}, [(1, 3)], verdicts=verdicts, size=64)
    assert [[row.key.est_id for row in field.verdicts] for field in fields] == [[], [0]]
    with pytest.raises(
        MismatchError, match="verdicts are on estimates by a, but the estimates are by b"
    ):
        overlays(dataset, {"b": one}, [(1, 3)], verdicts=verdicts, size=64)
