"""Weights are for the objects that they were trained for, and refuse others of the same number."""

from __future__ import annotations

import json
import logging
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections
from graspcast.cli import main
from graspcast.demo_data import demo_dataset
from graspcast.errors import MismatchError
from graspcast.perception import BUILT_IN
from graspcast.perception.dense import DenseEstimator
from graspcast.perception.network import Network
from graspcast.perception.run import run_estimator
from graspcast.perception.trained_objects import TrainedObject, TrainedObjects


@pytest.fixture
def changed(tmp_path: Path) -> BopDataset:
    """The demonstration's dataset, whose models_info.json may be changed."""
    root = tmp_path / "ycbv"
    (root / "models").mkdir(parents=True)
    there = demo_dataset().root
    for name in ("camera.json", "test", "test_detections_jittered.json"):
        (root / name).symlink_to(there / name)
    shutil.copy(there / "models" / "models_info.json", root / "models")
    return BopDataset(root)


def scaled(dataset: BopDataset, obj_id: int, factor: float = 1.0, shift_mm: float = 0.0) -> None:
    path = dataset.root / "models" / "models_info.json"
    listed = json.loads(path.read_text())
    entry = listed[str(obj_id)]
    for key in entry:
        if not key.startswith("symm"):
            entry[key] *= factor
    entry["min_x"] += shift_mm
    path.write_text(json.dumps(listed))


@pytest.mark.parametrize("name", BUILT_IN)
def test_the_shipped_weights_name_dataset_and_sizes_of_the_demonstration(name: str) -> None:
    trained = Network(name).trained
    assert trained.dataset == "ycbv"
    demo = demo_dataset()
    trained.check(demo, list(trained.by_id))
    for obj_id, one in trained.by_id.items():
        assert one.diameter_m == pytest.approx(demo.models[obj_id].diameter_m, abs=1e-6)


def test_another_size_is_refused_with_both(changed: BopDataset) -> None:
    scaled(changed, 3, 0.95)
    trained = Network("dense").trained
    with pytest.raises(MismatchError) as error:
        trained.check(changed, [2, 3])
    text = str(error.value)
    assert "was trained for ycbv-3 (199 mm across)" in text
    assert "is ycbv-3 (189 mm across): they differ in diameter" in text
    assert error.value.parameters == ("bop", "weights")
    # Objects that are not asked for may be others, and so may those that it does not know.
    trained.check(changed, [2, 77])


def test_another_frame_is_refused(changed: BopDataset) -> None:
    scaled(changed, 2, shift_mm=40)
    with pytest.raises(MismatchError, match="differ in frame: the bounding boxes are 40 mm apart"):
        Network("dense").trained.check(changed, [2])


def test_another_dataset_with_objects_of_the_same_size_is_noted_and_of_another_refused(
    changed: BopDataset, demo_boxes: Detections, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    some = demo_boxes.select(np.arange(2))
    with caplog.at_level(logging.WARNING):
        run_estimator(DenseEstimator(), changed, some, tmp_path / "out.csv")
    assert "taken for the same" not in caplog.text
    with caplog.at_level(logging.WARNING):
        mine = BopDataset(changed.root, name="mine")
        run_estimator(DenseEstimator(), mine, some, tmp_path / "mine.csv")
    assert "trained for objects of ycbv; those of mine have the same numbers" in caplog.text
    for number in set(some.obj_id.tolist()):
        scaled(changed, number, 0.9)
    other = BopDataset(changed.root, name="mine")
    with pytest.raises(MismatchError, match=r"is mine-\d+ .*they differ in diameter") as error:
        run_estimator(DenseEstimator(), other, some, tmp_path / "other.csv")
    assert "Otherwise train weights for mine" in str(error.value)
    assert not (tmp_path / "other.csv").exists()


def test_the_command_line_takes_a_name_for_the_directory(
    changed: BopDataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = changed.root.rename(tmp_path / "copy")
    boxes = json.loads((copy / "test_detections_jittered.json").read_text())
    (tmp_path / "boxes.json").write_text(json.dumps(boxes[:2]))
    words = ["estimate", "--estimator", "direct", "--detections", str(tmp_path / "boxes.json")]
    words += ["--out", str(tmp_path / "direct_ycbv-test.csv"), "--bop"]
    assert main([*words, str(copy)]) == 0
    assert "taken for the same" in capsys.readouterr().err
    assert main([*words, f"ycbv={copy}"]) == 0
    assert "taken for the same" not in capsys.readouterr().err


def test_weights_without_a_name_are_compared_by_size_alone(
    changed: BopDataset,
    demo_boxes: Detections,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    estimator = DenseEstimator()
    estimator.network.trained = replace(estimator.network.trained, dataset=None)
    some = demo_boxes.select(np.arange(2))
    with caplog.at_level(logging.WARNING):
        run_estimator(estimator, BopDataset(changed.root, name="x"), some, tmp_path / "out.csv")
    assert "does not say which dataset it was trained for" in caplog.text


def test_a_trained_object_is_read_from_metadata() -> None:
    entry = {"obj_id": 3, "diameter_m": 0.2, "lower": [0, 0, 0], "size": [0.1, 0.1, 0.1]}
    with pytest.raises(KeyError):
        TrainedObject.from_metadata(entry)
    one = TrainedObject.from_metadata(entry | {"keypoints": [[0, 0, 0]]})
    assert one.keypoints.shape == (1, 3)
    assert TrainedObjects("a.onnx", None, {3: one}).by_id[3].diameter_m == 0.2
