"""Detections: files as detectors write them, and the jittered ones of our own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.testing import assert_array_equal

from bop_images import IMAGES, box, write_boxes, write_dataset
from graspcast.bop.dataset import BopDataset, Target, read_targets
from graspcast.bop.detections import Detections, jittered, read_detections, write_detections
from graspcast.errors import FormatError, InputError


@pytest.fixture
def dataset(tmp_path: Path) -> BopDataset:
    return write_dataset(tmp_path / "made")


def test_a_file_as_detectors_write_it(tmp_path: Path, dataset: BopDataset) -> None:
    path = write_boxes(
        tmp_path / "d.json", box(2, 3, category_id=5), box(), box(bbox=[-5, 10, 30, 20], score=-2)
    )
    found = read_detections(path, dataset)
    assert found.scene_id.tolist() == [2, 1, 1]
    assert found.im_id.tolist() == [3, 3, 3]
    assert found.obj_id.tolist() == [5, 1, 1]
    assert found.score.tolist() == [0.9999793767929077, 0.9999793767929077, -2]
    assert found.box_xywh[2].tolist() == [-5, 10, 30, 20]
    assert (found.source, found.detector, found.dropped) == (str(path), "", {})
    images = found.images()
    assert list(images) == [(1, 3), (2, 3)]
    assert images[1, 3].obj_id.tolist() == [1, 1]


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        (box(bbox=[1, 2, float("nan"), 4]), "entry 1, bbox: should be 4 finite numbers"),
        (box(bbox=[1, 2, 3]), "entry 1, bbox: should be 4 finite numbers"),
        (box(bbox=[10, 10, 0, 5]), r"entry 1: the box \[10, 10, 0, 5\] is empty"),
        (box(bbox=[50, 50, 5, -40]), "not two corners"),
        (box(bbox=[96, 10, 5, 5]), "lies outside of the image, which has 96 x 64 pixels"),
        (box(bbox=[10, -9, 5, 9]), "lies outside of the image"),
        (box(bbox=[10, 10, 0.5, 20]), "is smaller than 1 pixel"),
        (box(score=float("inf")), "entry 1, score: should be 1 finite number"),
        (box(score=None), "entry 1, score: should be 1 finite number"),
        (box(category_id=1.5), "entry 1, category_id: 1.5 is not a whole number"),
        (box(image_id=-1), "entry 1, image_id: -1 is not a whole number"),
        ({"scene_id": 1}, "no 'image_id'; found scene_id"),
        (3, "entry 1: should be an object"),
        (box(2, 3), "entry 1: repeats the object and box of entry 0"),
        (box(category_id=2), r"object 2 is not in .*models_info.json, which has 1, 5$"),
        (box(image_id=4), r"no image 1/4 in .*test$"),
    ],
)
def test_wrong_entries_are_named_or_skipped(
    tmp_path: Path, dataset: BopDataset, entry: Any, says: str
) -> None:
    path = write_boxes(tmp_path / "d.json", box(2, 3), entry, box(category_id=5))
    with pytest.raises(FormatError, match=says) as caught:
        read_detections(path, dataset)
    assert "d.json, entry 1" in str(caught.value)
    found = read_detections(path, dataset, lenient=True)
    assert found.obj_id.tolist() == [1, 5]
    assert sum(found.dropped.values()) == 1


def test_boxes_as_shares_of_the_image_are_refused(tmp_path: Path, dataset: BopDataset) -> None:
    shares = [box(bbox=[0.1, 0.2, 0.3, 0.4]), box(2, 3, bbox=[0.5, -0.1, 1.02, 0.4])]
    path = write_boxes(tmp_path / "d.json", *shares)
    for lenient in (False, True):
        with pytest.raises(FormatError, match=r"shares of the image\?"):
            read_detections(path, dataset, lenient=lenient)


def test_boxes_as_two_corners_are_refused(tmp_path: Path, dataset: BopDataset) -> None:
    corners = [[10, 20, 60, 60], [50, 5, 90, 40], [30, 30, 70, 62]]
    path = write_boxes(tmp_path / "d.json", *(box(bbox=corner) for corner in corners))
    with pytest.raises(FormatError, match=r"3 of 3 boxes end beyond the image.*two corners, which"):
        read_detections(path, dataset, lenient=True)
    path = write_boxes(tmp_path / "few.json", box(bbox=corners[0]))
    (remark,) = read_detections(path, dataset).remarks
    assert remark.endswith("are they two corners?")
    # Amodal boxes of objects that the image cuts off.
    cut = [[-20, -5, 60, 50], [70, 30, 40, 40], [60, 40, 50, 40]]
    path = write_boxes(tmp_path / "cut.json", *(box(bbox=one) for one in cut))
    (remark,) = read_detections(path, dataset).remarks
    assert "2 of 3 boxes end beyond the image of 96 x 64 pixels" in remark
    assert "two corners" not in remark
    path = write_boxes(tmp_path / "right.json", box(), box(bbox=[-20, -5, 60, 50]))
    assert read_detections(path, dataset).remarks == ()


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("{}", "should hold a list"),
        ("[", "is not valid JSON"),
        ("", "is not valid JSON"),
        ('{"1/3": {"bbox_est": [1, 2, 3, 4]}}', "'1/3': should be a list of boxes"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: str, says: str) -> None:
    (tmp_path / "d.json").write_text(content)
    with pytest.raises(FormatError, match=says):
        read_detections(tmp_path / "d.json", lenient=True)


_NUMBERS = st.integers(0, 2**31 - 1)
_FINITE = st.floats(-1e6, 1e6, allow_subnormal=False)


@given(st.data(), st.integers(0, 5))
def test_what_is_written_is_read_again(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, n: int
) -> None:
    def column(elements: st.SearchStrategy[Any], dtype: type, *shape: int) -> np.ndarray:
        return data.draw(arrays.arrays(dtype, (n, *shape), elements=elements))

    boxes = column(_FINITE, np.float64, 4)
    boxes[:, 2:] = np.abs(boxes[:, 2:]) + 3
    given_ones = Detections(
        scene_id=column(_NUMBERS, np.int64),
        im_id=np.arange(n),
        obj_id=column(_NUMBERS, np.int64),
        score=column(_FINITE, np.float64),
        box_xywh=boxes,
        detector=data.draw(st.sampled_from(["", "yolo"])) if n else "",
    )
    path = tmp_path_factory.mktemp("d") / "d.json"
    write_detections(path, given_ones)
    again = read_detections(path)
    for name in ("scene_id", "im_id", "obj_id", "score", "box_xywh"):
        assert_array_equal(getattr(again, name), getattr(given_ones, name))
    assert again.detector == given_ones.detector


def test_jittered_boxes_are_near_the_true_ones_and_say_what_they_are(
    tmp_path: Path, dataset: BopDataset
) -> None:
    found = jittered(dataset, 7, shift=0.1, scale=0.2)
    truth = dataset.ground_truth
    assert truth.box_xywh is not None
    assert len(found) == len(truth) == 2 * len(IMAGES)
    assert_array_equal(found.obj_id, truth.obj_id)
    size = truth.box_xywh[:, 2:]
    change = found.box_xywh[:, 2:] / size - 1
    centres = [b[:, :2] + b[:, 2:] / 2 for b in (found.box_xywh, truth.box_xywh)]
    moved = (centres[0] - centres[1]) / size
    assert np.abs(change).max() <= 0.2 + 1e-12
    assert np.abs(moved).max() <= 0.1 + 1e-12
    assert len(np.unique(moved)) == moved.size
    assert np.abs(moved).max() > 0.01
    path = tmp_path / "jittered.json"
    write_detections(path, found)
    assert (
        read_detections(path, dataset).detector == "jittered ground truth, seed 7, not a detector"
    )
    assert all("not a detector" in entry["detector"] for entry in json.loads(path.read_text()))


def test_jitter_depends_on_the_instance_and_the_seed_alone(dataset: BopDataset) -> None:
    all_of_them = jittered(dataset, 1)
    assert_array_equal(jittered(dataset, 1).box_xywh, all_of_them.box_xywh)
    assert (jittered(dataset, 2).box_xywh != all_of_them.box_xywh).all()
    one = jittered(dataset, 1, targets=[Target(1, 8, 5, 1)])
    row = (all_of_them.im_id == 8) & (all_of_them.obj_id == 5)
    assert_array_equal(one.box_xywh, all_of_them.box_xywh[row])
    assert len(jittered(dataset, 1, targets=[Target(1, 8)])) == 2


def test_jitter_needs_boxes_of_visible_instances(dataset: BopDataset) -> None:
    path = dataset.scenes / "000001" / "scene_gt_info.json"
    info = json.loads(path.read_text())
    info["3"][0] |= {"visib_fract": 0.05}
    info["8"][0] |= {"bbox_obj": [-1, -1, -1, -1]}
    del info["8"][1]["bbox_obj"]
    path.write_text(json.dumps(info))
    found = jittered(BopDataset(dataset.root), 0)
    assert list(zip(found.scene_id, found.im_id, found.obj_id, strict=True)) == [
        (1, 3, 5),
        (2, 3, 1),
        (2, 3, 5),
    ]
    with pytest.raises(InputError, match="none of the instances is at least 10% visible"):
        jittered(BopDataset(dataset.root), 0, targets=[Target(1, 8)])
    for info_path in dataset.scenes.glob("*/scene_gt_info.json"):
        info_path.unlink()
    with pytest.raises(InputError, match="has a bbox_obj"):
        jittered(BopDataset(dataset.root), 0)


@pytest.mark.slow
def test_real_boxes_are_jittered(data_dir: Path, tmp_path: Path) -> None:
    dataset = BopDataset(data_dir / "bop" / "lmo")
    targets = read_targets(dataset.root / "test_targets_bop19.json")
    found = jittered(dataset, 0, targets=targets)
    assert len(found) == len(targets)
    write_detections(tmp_path / "d.json", found)
    assert_array_equal(read_detections(tmp_path / "d.json", dataset).box_xywh, found.box_xywh)
