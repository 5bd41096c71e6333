"""The estimate of a single trial."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bop_images import estimates_of, write_dataset
from graspcast.errors import InputError
from graspcast.simulation.trial.estimate import estimate_in_image, estimate_with_error


def test_an_error_in_millimetres_and_degrees() -> None:
    obj_T_est = estimate_with_error([10, 0, -5, 0, 30, 0])
    np.testing.assert_allclose(obj_T_est[:3, 3], [0.010, 0, -0.005])
    expected = Rotation.from_euler("y", 30, degrees=True).as_matrix()
    np.testing.assert_allclose(obj_T_est[:3, :3], expected, atol=1e-15)
    with pytest.raises(InputError, match="not six finite numbers") as caught:
        estimate_with_error([0, 0, np.inf, 0, 0, 0])
    assert caught.value.parameters == ("offset",)


def test_an_estimate_relative_to_the_true_pose(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path / "made")
    truth, results = dataset.ground_truth, estimates_of(dataset)
    for i in range(len(truth)):
        image, number = (int(truth.scene_id[i]), int(truth.im_id[i])), int(truth.obj_id[i])
        mine = results.select(results.obj_id == number)
        obj_T_est = estimate_in_image(mine, truth, f"made-{number}", image, 0)
        expected = np.linalg.inv(truth.cam_T_obj[i]) @ results.cam_T_obj[i]
        np.testing.assert_allclose(obj_T_est, expected, atol=1e-12)
    mine = results.select(results.obj_id == 5)
    with pytest.raises(InputError, match="there are 1, counted from 0") as caught:
        estimate_in_image(mine, truth, "made-5", (1, 3), 1)
    assert caught.value.parameters == ("est_id",)
    without = replace(mine, im_id=mine.im_id + 5)  # image 1/8 stays one, 1/13 is none
    with pytest.raises(InputError, match="no ground truth for estimate 0 of made-5"):
        estimate_in_image(without, truth, "made-5", (1, 13), 0)
