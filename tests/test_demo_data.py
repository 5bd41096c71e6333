"""The demonstration dataset in the package."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from graspcast import Estimate, Frame, Watcher
from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import jittered, read_detections
from graspcast.demo_data import demo_dataset, demo_model, model_path
from graspcast.errors import FormatError
from graspcast.pose.transforms import rotation_from_vector, transform


@pytest.fixture(scope="module")
def dataset() -> BopDataset:
    return demo_dataset()


def test_the_boxes_that_ship_are_those_that_render_writes(
    dataset: BopDataset,
) -> None:
    boxes = read_detections(dataset.root / "test_detections_jittered.json", dataset)
    seed = json.loads((dataset.root / "render.json").read_text())["settings"]["seed"]
    again = jittered(dataset, seed)
    np.testing.assert_array_equal(again.box_xywh, boxes.box_xywh)
    assert "not a detector" in boxes.detector


def test_the_images_that_ship_are_small_and_many(dataset: BopDataset) -> None:
    assert sum(path.stat().st_size for path in dataset.root.rglob("*")) <= 12_000_000
    assert len(dataset.images) >= 200
    assert len({scene for scene, _ in dataset.images}) >= 20
    assert "settings" in json.loads((dataset.root / "render.json").read_text())


def seen(dataset: BopDataset, error_m: float, seed: int = 0) -> list[Frame]:
    """The first image of twenty tables, with poses that are so far off."""
    rng = np.random.default_rng(seed)
    out = []
    for scene in range(1, 21):
        truth = dataset.ground_truth
        mine = truth.scene_id == scene
        mine &= truth.im_id == truth.im_id[mine].min()
        estimates = {}
        for name in ("dense", "direct", "keypoints"):
            poses = []
            for number, pose in zip(truth.obj_id[mine], truth.cam_T_obj[mine], strict=True):
                turn = rotation_from_vector(rng.normal(size=3) * error_m * 5)
                off = transform(turn, rng.normal(size=3) * error_m)
                poses.append(Estimate(f"ycbv-{number}", pose @ off))
            estimates[name] = poses
        out.append(Frame(estimates))
    return out


def test_the_model_that_ships_judges_by_disagreement(dataset: BopDataset) -> None:
    watcher = Watcher.load("demo", threshold=0.5)
    watcher.warm_up()
    found = []
    for error_m in (0.002, 0.02):
        answers = watcher.judge_all(seen(dataset, error_m))
        decisions = [d for answer in answers for d in answer]  # type: ignore[union-attr]
        assert all(d.cam_T_grasp is not None for d in decisions)
        probability = [d.probability for d in decisions if d.probability is not None]
        found.append((np.mean(probability), np.mean([d.attempt for d in decisions])))
    (near, tried), (far, seldom) = found
    assert near > far + 0.2 and tried > seldom + 0.2


def test_the_model_that_ships_is_small_and_no_file_comes_before_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert demo_model().stat().st_size < 3_000_000
    (tmp_path / "demo").write_text("something else")
    monkeypatch.chdir(tmp_path)
    assert "dense with direct, keypoints" in repr(Watcher.load("demo"))
    assert model_path("demo") == demo_model() and model_path("./demo") == Path("demo")
    with pytest.raises(FormatError):
        Watcher.load("./demo")
