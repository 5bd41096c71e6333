"""Conversion of poses: several files, transforms, the dataset's models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bop_images import estimates_of, write_dataset
from graspcast.bop.pose_rows import Stated
from graspcast.bop.results import write_results
from graspcast.errors import FormatError, InputError
from graspcast.estimates.conversion import applied, convert_poses
from pose_files import megapose_entries, write_json
from poses import random_poses, results_of

TURNED = np.array([[0.0, -1, 0, 0.01], [1, 0, 0, 0], [0, 0, 1, -0.02], [0, 0, 0, 1]])


def test_transforms_are_applied_on_the_side_of_the_object() -> None:
    results = results_of(random_poses(4))
    assert_allclose(applied(results, {None: TURNED}).cam_T_obj, results.cam_T_obj @ TURNED)
    back = applied(applied(results, {1: TURNED}), {1: np.linalg.inv(TURNED)})
    assert_allclose(back.cam_T_obj, results.cam_T_obj, atol=1e-12)


def test_transforms_of_what_is_not_there(tmp_path: Path) -> None:
    made = write_dataset(tmp_path / "made")
    results = estimates_of(made)
    with pytest.raises(InputError, match=r"a transform for object 7, but .* has poses of 1, 5"):
        applied(results, {7: TURNED})
    with pytest.raises(InputError, match="has poses of objects 1, 5; say of which"):
        applied(results, {None: TURNED})
    far = np.eye(4)
    far[:3, 3] = 5.0
    with pytest.raises(InputError, match="behind the camera, in image"):
        applied(results, {1: far, 5: -far @ far})
    one = applied(results, {5: TURNED})
    assert_array_equal(one.cam_T_obj[results.obj_id == 1], results.cam_T_obj[results.obj_id == 1])


def test_files_of_several_images_are_put_together(tmp_path: Path) -> None:
    paths = [
        write_json(tmp_path / f"{i}.json", megapose_entries(results_of(random_poses(1, i))))
        for i in range(2)
    ]
    with pytest.raises(InputError, match=r"1.json: object 1 in image 1/7 is in .*0.json"):
        convert_poses(paths, stated=Stated(1, 7))
    found = convert_poses(paths[:1], stated=Stated(1, 7))
    assert found.remarks == (f"{paths[0]}: has no scores; they become 0",)


@pytest.mark.ill_typed
def test_one_path_is_no_list_of_paths(tmp_path: Path) -> None:
    wrong: Any = str(tmp_path)
    with pytest.raises(InputError, match="convert_poses: paths should be a list of"):
        convert_poses(wrong)


def test_poses_are_held_against_the_dataset(tmp_path: Path) -> None:
    made = write_dataset(tmp_path / "made")
    path = tmp_path / "a.csv"
    write_results(path, estimates_of(made))
    assert len(convert_poses([path], dataset=made)) == 6
    write_results(path, results_of(random_poses(3), obj_id=9))
    with pytest.raises(FormatError, match=r"object 9 is not in .*which has 1, 5"):
        convert_poses([path], dataset=made)
