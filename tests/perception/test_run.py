"""An estimator on the images of a dataset."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray
from numpy.testing import assert_allclose

from bop_images import FOCAL, IMAGES, SIZE, box, write_boxes, write_image
from crude import BoxEstimator, left_behind, run
from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections, read_detections
from graspcast.bop.results import read_results
from graspcast.errors import (
    FormatError,
    InputError,
    UnknownNameError,
)
from graspcast.perception.estimator import Poses
from graspcast.perception.run import run_estimator


def test_the_image_loop_agrees_with_the_command(
    python: Path, dataset: BopDataset, boxes: Path, tmp_path: Path
) -> None:
    estimator = BoxEstimator(dataset.models)
    seen: list[tuple[float, str]] = []
    results = run_estimator(
        estimator,
        dataset,
        read_detections(boxes, dataset),
        tmp_path / "own.csv",
        progress=lambda share, words: seen.append((share, words)),
    )
    run(python, dataset, boxes, tmp_path / "foreign.csv")
    own, foreign = read_results(tmp_path / "own.csv"), read_results(tmp_path / "foreign.csv")
    assert_allclose(own.cam_T_obj, foreign.cam_T_obj, atol=1e-12)
    assert np.array_equal(own.cam_T_obj, results.cam_T_obj)
    assert seen == [(i / 3, f"{i} of 3 images") for i in range(len(IMAGES))]
    for (image, K, detections), key in zip(estimator.calls, IMAGES, strict=True):
        assert np.array_equal(image, dataset.image(*key))
        assert_allclose(K, [[FOCAL, 0, SIZE[0] / 2], [0, FOCAL, SIZE[1] / 2], [0, 0, 1]])
        assert set(zip(detections.scene_id, detections.im_id, strict=True)) == {key}
        times = own.time_s[(own.scene_id == key[0]) & (own.im_id == key[1])]
        assert len(set(times.tolist())) == 1  # the seconds that the image took
        assert times[0] >= 0.01


def test_only_images_with_detections_are_read_and_nothing_found_is_no_row(
    dataset: BopDataset, tmp_path: Path
) -> None:
    write_image(dataset.images[2, 3], mode="RGBA")  # would be refused
    small = box(1, 8, bbox=[10, 10, 3, 3])
    path = write_boxes(tmp_path / "d.json", box(), box(1, 8), small)
    estimator = BoxEstimator(dataset.models)
    results = run_estimator(estimator, dataset, read_detections(path), tmp_path / "out.csv")
    assert results.im_id.tolist() == [3, 8]
    assert [len(call[2]) for call in estimator.calls] == [1, 2]


def test_objects_that_the_estimator_does_not_know(dataset: BopDataset, tmp_path: Path) -> None:
    path = write_boxes(tmp_path / "d.json", box(category_id=5), box())
    estimator = BoxEstimator(dataset.models)
    estimator.obj_ids = (1,)
    found, out = read_detections(path, dataset), tmp_path / "out.csv"
    with pytest.raises(UnknownNameError, match=r"unknown object '5'; known: 1. box was trained"):
        run_estimator(estimator, dataset, found, out)
    assert not out.exists()
    results = run_estimator(estimator, dataset, found, out, lenient=True)
    assert results.dropped == {"object that the estimator does not know": 1}
    assert results.obj_id.tolist() == [1]
    estimator.obj_ids = (9,)
    with pytest.raises(InputError, match="no detection that box could use"):
        run_estimator(estimator, dataset, found, out, lenient=True)


def test_a_bad_image_ends_it_without_results(dataset: BopDataset, boxes: Path) -> None:
    write_image(dataset.images[2, 3], mode="RGBA")
    folder = boxes.parent / "results"
    with pytest.raises(FormatError, match=r"000003.png: has an alpha channel"):
        run_estimator(
            BoxEstimator(dataset.models), dataset, read_detections(boxes), folder / "out.csv"
        )
    assert left_behind(folder) == []


def test_poses_that_are_none_are_refused(dataset: BopDataset, boxes: Path) -> None:
    class Broken(BoxEstimator):
        def estimate(self, image: ndarray, K: ndarray, detections: Detections) -> Poses:
            poses = super().estimate(image, K, detections)
            poses.cam_T_obj[0, 0, 3] = np.nan
            return poses

    out = boxes.with_name("out.csv")
    with pytest.raises(FormatError, match=r"as the estimator wrote it, line 2: t is 'nan"):
        run_estimator(Broken(dataset.models), dataset, read_detections(boxes), out)
    assert not out.exists()


def test_progress_goes_from_image_to_image(
    dataset: BopDataset, boxes: Path, tmp_path: Path
) -> None:
    calls: list[tuple[float, str]] = []
    run_estimator(
        BoxEstimator(dataset.models),
        dataset,
        read_detections(boxes, dataset),
        tmp_path / "out.csv",
        progress=lambda share, message: calls.append((share, message)),
    )
    shares = [share for share, _ in calls]
    assert shares[0] == 0.0 and shares == sorted(shares) and shares[-1] < 1.0
    assert calls[0][1] == "0 of 3 images"
