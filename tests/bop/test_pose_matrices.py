"""Poses as text files of 4x4 matrices."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from graspcast.bop.pose_rows import Stated
from graspcast.bop.results import read_results
from graspcast.errors import FormatError
from pose_files import write_matrices
from poses import random_poses, results_of

RESULTS = results_of(random_poses(3))
STATED = Stated(scene_id=2, objects={"": 9})


def test_a_directory_of_matrices(tmp_path: Path) -> None:
    folder = write_matrices(tmp_path / "ob_in_cam", RESULTS)
    found = read_results(folder, stated=STATED)
    assert_allclose(found.cam_T_obj, RESULTS.cam_T_obj)
    assert (found.scene_id.tolist(), found.obj_id.tolist()) == ([2] * 3, [9] * 3)
    assert found.im_id.tolist() == [0, 1, 2]
    alone = read_results(folder / "000001.txt", stated=Stated(2, 70, {"": 9}))
    assert alone.im_id.tolist() == [70]
    for stated, parameter in ((Stated(), "scene_id"), (Stated(scene_id=2), "object_numbers")):
        with pytest.raises(FormatError, match="ob_in_cam: does not say which") as caught:
            read_results(folder, stated=stated)
        assert caught.value.parameters == (parameter,)


@pytest.mark.parametrize(
    ("name", "matrix", "says"),
    [
        ("1581120424100262102.txt", np.eye(4), "its name should be the image's number"),
        ("2.txt", RESULTS.cam_T_obj[0], "is of image 2, as 000002.txt is"),
        ("7.txt", np.eye(3), "7.txt: is not a 4x4 matrix"),
        ("7.txt", RESULTS.cam_T_obj[0].T, "7.txt: is no transform; its last row is"),
    ],
)
def test_wrong_files_are_named(tmp_path: Path, name: str, matrix: np.ndarray, says: str) -> None:
    folder = write_matrices(tmp_path / "ob_in_cam", RESULTS)
    np.savetxt(folder / name, matrix)
    with pytest.raises(FormatError, match=says):
        read_results(folder, stated=STATED)
