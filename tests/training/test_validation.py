"""Validation: errors by object, of the shipped weights on the demonstration's images."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from graspcast.demo_data import demo_dataset
from graspcast.estimates.error_tables import measure
from graspcast.perception import built_in
from graspcast.perception.run import run_estimator
from graspcast.training.objects import Objects
from graspcast.training.validation import ERRORS, in_words, measure_errors, validation_images


@pytest.mark.slow
def test_errors_are_those_that_the_tables_measure(tmp_path: Path) -> None:
    from graspcast.bop.detections import read_detections

    demo = demo_dataset()
    boxes = json.loads((demo.root / "test_detections_jittered.json").read_text())
    path = tmp_path / "some.json"
    path.write_text(json.dumps(boxes[:40]))
    found = measure_errors(
        "direct", demo.root.parents[1] / "perception/weights/direct.onnx", demo, path
    )
    results = run_estimator(
        built_in("direct"), demo, read_detections(path, demo), tmp_path / "direct_ycbv-test.csv"
    )
    errors = measure(results, demo, only=("rotation_deg", "translation_mm"))
    assert found[-1]["obj_id"] is None and found[-1]["detections"] == 40
    assert found[-1]["rotation_deg_50"] == pytest.approx(errors["rotation_deg"].median(), abs=0.01)
    of_one = errors.filter(errors["obj_id"] == found[0]["obj_id"])
    assert found[0]["poses"] == len(of_one)
    wanted = of_one["translation_mm"].quantile(0.9, "linear")
    assert found[0]["translation_mm_90"] == pytest.approx(wanted, abs=0.01)


def test_in_words() -> None:
    none = {"obj_id": 4, "detections": 3, "poses": 0} | dict.fromkeys(ERRORS)
    some = {"obj_id": None, "detections": 5, "poses": 2}
    some |= dict(zip(ERRORS, (1.0, 2.25, 30.04, 4), strict=True))
    assert in_words([none, some], "toy") == [
        ["toy-4", "0 of 3", "-", "-", "-", "-"],
        ["all", "2 of 5", "1.0", "2.2", "30.0", "4.0"],
    ]


@pytest.mark.slow
def test_validation_images_are_rendered_once(solids: Objects, tmp_path: Path) -> None:
    dataset = validation_images(tmp_path / "validation", solids, images=3, seed=1)
    assert dataset.name == "toy" and len(dataset.images) == 8
    written = (tmp_path / "validation" / "render.json").stat().st_mtime_ns
    validation_images(tmp_path / "validation", solids, images=3, seed=1)
    assert (tmp_path / "validation" / "render.json").stat().st_mtime_ns == written
