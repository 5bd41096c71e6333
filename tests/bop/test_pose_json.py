"""Poses in JSON files: SAM-6D, MegaPose, happypose."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_allclose

from graspcast.bop.pose_rows import Stated
from graspcast.bop.results import read_results
from graspcast.errors import FormatError
from pose_files import megapose_entries, sam6d_entries, write_json
from poses import random_poses, results_of

RESULTS = results_of(random_poses(4), obj_id=5, scene_id=48)


def test_sam6d(tmp_path: Path) -> None:
    path = write_json(tmp_path / "detection_pem.json", sam6d_entries(RESULTS))
    found = read_results(path)
    assert_allclose(found.cam_T_obj, RESULTS.cam_T_obj, atol=1e-12)
    assert (found.scene_id.tolist(), found.im_id.tolist()) == ([48] * 4, [0, 1, 2, 3])
    assert (found.obj_id.tolist(), found.score.tolist()) == ([5] * 4, RESULTS.score.tolist())
    assert found.time_s.tolist() == [0.25] * 4


def test_sam6d_of_one_image_that_it_does_not_know(tmp_path: Path) -> None:
    entries = sam6d_entries(results_of(random_poses(1)))
    entries[0] |= {"scene_id": -1, "image_id": 0, "category_id": 1}
    path = write_json(tmp_path / "detection_pem.json", entries)
    with pytest.raises(FormatError, match="entry 0: does not say which scene") as caught:
        read_results(path)
    assert caught.value.parameters == ("scene_id",)
    found = read_results(path, stated=Stated(2, 7, {"": 5}))
    assert (found.scene_id[0], found.im_id[0], found.obj_id[0]) == (2, 7, 5)


def test_what_is_stated_may_not_contradict_the_file(tmp_path: Path) -> None:
    path = write_json(tmp_path / "detection_pem.json", sam6d_entries(RESULTS))
    with pytest.raises(FormatError, match="entry 0: is of scene 48, not of 2"):
        read_results(path, stated=Stated(scene_id=2))


def test_megapose(tmp_path: Path) -> None:
    path = write_json(tmp_path / "object_data.json", megapose_entries(RESULTS))
    found = read_results(path, stated=Stated(48, 7))
    assert_allclose(found.cam_T_obj, RESULTS.cam_T_obj, atol=1e-9)
    assert (found.scene_id[0], found.im_id[0], found.obj_id[0]) == (48, 7, 5)
    assert found.score.tolist() == [0] * 4
    assert found.remarks == ("has no scores; they become 0",)
    with pytest.raises(FormatError, match="does not say which scene it is of"):
        read_results(path)
    named = write_json(tmp_path / "named.json", megapose_entries(RESULTS, "mug"))
    with pytest.raises(FormatError, match=r"which object is 'mug'.*State its number") as caught:
        read_results(named, stated=Stated(48, 7))
    assert caught.value.parameters == ("object_numbers",)
    assert read_results(named, stated=Stated(48, 7, {"mug": 9})).obj_id.tolist() == [9] * 4


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"TWO": [[0, 0, 0, 2], [0, 0, 1]]}, "entry 0, TWO: the quaternion has length 2, not 1"),
        ({"TWO": [[0, 0, 0, 1]]}, "entry 0, TWO: should be a quaternion"),
        ({"TWO": [[0, 0, 0, 1], [0, 0]]}, "TWO, position: should be 3 finite numbers"),
        ({"TWO": [[0, 0, 0, 1], [0, 0, 900.0]]}, "is it in millimetres .*, not in metres"),
    ],
)
def test_wrong_object_data_is_named(tmp_path: Path, change: Any, says: str) -> None:
    (entry, *_) = megapose_entries(RESULTS)
    path = write_json(tmp_path / "object_data.json", [{**entry, **change}])
    with pytest.raises(FormatError, match=says):
        read_results(path, stated=Stated(48, 7))


def test_wrong_entries_of_sam6d_are_named(tmp_path: Path) -> None:
    entries = sam6d_entries(RESULTS)
    del entries[2]["t"]
    with pytest.raises(FormatError, match="entry 2: no 't'; found scene_id"):
        read_results(write_json(tmp_path / "a.json", entries))
    entries[2]["t"] = [1, 2]
    with pytest.raises(FormatError, match="entry 2, t: should be 3 finite numbers"):
        read_results(write_json(tmp_path / "a.json", entries))
