"""Files of detections of several projects give the same detections."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_array_equal

from bop_images import write_dataset, write_image
from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import read_detections
from graspcast.errors import FormatError
from pose_files import write_json

BOXES = [(1, 3, 1, [10, 20, 30, 20]), (1, 3, 5, [40, 10, 20, 30]), (2, 3, 1, [5, 6, 7, 8])]
BOP = [
    {"scene_id": s, "image_id": i, "category_id": o, "score": 1.0, "bbox": b}
    for s, i, o, b in BOXES
]
GDRNPP = {
    key: [{"obj_id": o, "bbox_est": b, "score": 1.0} for s, i, o, b in BOXES if f"{s}/{i}" == key]
    for key in ("1/3", "2/3")
}
COCO = {
    "images": [
        {"id": 0, "file_name": "000001/rgb/000003.png"},
        {"id": 7, "file_name": "data/test/000002/rgb/000003.jpg"},
    ],
    "annotations": [
        {"id": n, "image_id": 7 if s == 2 else 0, "category_id": o, "bbox": b, "iscrowd": 0}
        for n, (s, _, o, b) in enumerate(BOXES)
    ],
    "categories": [],
}


@pytest.mark.parametrize("content", [BOP, GDRNPP, COCO])
@pytest.mark.parametrize("packed", [False, True])
def test_every_form_gives_the_same(tmp_path: Path, content: Any, packed: bool) -> None:
    dataset = write_dataset(tmp_path / "made")
    path = write_json(tmp_path / "d.json", content)
    if packed:
        path = path.with_suffix(".json.gz")
        path.write_bytes(gzip.compress(json.dumps(content).encode()))
    found = read_detections(path, dataset)
    assert found.scene_id.tolist() == [s for s, *_ in BOXES]
    assert found.im_id.tolist() == [3] * 3
    assert found.obj_id.tolist() == [o for *_, o, _ in BOXES]
    assert_array_equal(found.box_xywh, [b for *_, b in BOXES])
    assert found.score.tolist() == [1.0] * 3
    assert found.in_file is (content is BOP)


def test_the_scene_may_be_the_folder_of_a_coco_file(tmp_path: Path) -> None:
    (tmp_path / "000048").mkdir()
    content = {**COCO, "images": [{"id": i, "file_name": f"rgb/{i:06d}.png"} for i in (0, 7)]}
    found = read_detections(write_json(tmp_path / "000048" / "scene_gt_coco.json", content))
    assert found.scene_id.tolist() == [48] * 3
    assert found.im_id.tolist() == [0, 0, 7]
    with pytest.raises(FormatError, match=r"image 0: file_name is 'rgb/000000.png', which"):
        read_detections(write_json(tmp_path / "coco.json", content))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"1/3": {}}, "'1/3': should be a list of boxes"),
        ({"1/3/5": []}, "'1/3/5': should be SCENE/IMAGE"),
        ({"1/x": []}, "'1/x': 'x' is not a whole number"),
        ({"1/3": [{"bbox_est": [1, 2, 3, 4], "score": 1}]}, "1/3, box 0: no 'obj_id'; found"),
        ({"1/3": [5]}, "1/3, box 0: should be an object"),
        ({"annotations": [{"image_id": 9}], "images": []}, "image_id 9 is not among its images"),
        ({"annotations": {}, "images": []}, "annotations: should be a list"),
        ({"annotations": []}, "images: should be a list"),
        (
            {"boxes": []},
            "should hold a list at its top level, .*GDRNPP.* It is an object",
        ),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, content: Any, says: str) -> None:
    with pytest.raises(FormatError, match=says):
        read_detections(write_json(tmp_path / "d.json", content))


def test_shares_and_corners_are_found_in_every_form(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path / "made")
    shares = {"1/3": [{"obj_id": 1, "bbox_est": [0.1, 0.2, 0.3, 0.4], "score": 1}]}
    with pytest.raises(FormatError, match=r"shares of the image\?"):
        read_detections(write_json(tmp_path / "d.json", shares), dataset)
    corners = [{"obj_id": 1, "bbox_est": [50 + i, 30, 90, 60], "score": 1} for i in range(3)]
    with pytest.raises(FormatError, match="these are two corners"):
        read_detections(write_json(tmp_path / "d.json", {"1/3": corners}), dataset)


def test_a_box_is_held_against_its_own_image(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path / "made")
    entry = {"scene_id": 2, "image_id": 3, "category_id": 1, "score": 1}
    path = write_json(tmp_path / "d.json", [{**entry, "bbox": [150, 80, 30, 20]}])
    with pytest.raises(FormatError, match="outside of the image, which has 96 x 64 pixels"):
        read_detections(path, dataset)
    write_image(dataset.images[2, 3], size=(192, 128))
    K = [240.0, 0, 96, 0, 240, 64, 0, 0, 1]
    write_json(dataset.scenes / "000002" / "scene_camera.json", {"3": {"cam_K": K}})
    assert len(read_detections(path, BopDataset(dataset.root))) == 1
