"""The built-in estimators: conformance to the interface, and accuracy."""

from __future__ import annotations

from pathlib import Path

import pytest

from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections
from graspcast.estimates.error_tables import measure, summarise
from graspcast.perception import BUILT_IN, built_in
from graspcast.perception.conformance import check_estimator
from graspcast.perception.run import run_estimator


@pytest.mark.parametrize("name", BUILT_IN)
def test_they_keep_the_protocol(name: str, demo: BopDataset, demo_boxes: Detections) -> None:
    report = check_estimator(built_in(name), demo, demo_boxes)
    assert report.passed, str(report)


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILT_IN)
def test_they_are_as_good_as_is_said(
    name: str, demo: BopDataset, demo_boxes: Detections, tmp_path: Path
) -> None:
    # Some of the scenes of which training has seen none: those with even numbers.
    some = demo_boxes.select(demo_boxes.scene_id % 4 == 0)
    results = run_estimator(built_in(name), demo, some, tmp_path / "out.csv")
    assert len(results) > 0.95 * len(some)
    found = summarise(measure(results, demo, only=("rotation_deg", "translation_mm")))
    rows = [row for row in found.rows(named=True) if row["obj_id"] is not None]
    good = [
        row["obj_id"]
        for row in rows
        if row["rotation_deg_median"] <= 15 and row["translation_mm_median"] <= 25
    ]
    assert len(good) >= 4, rows
