"""Trial requests from estimates and ground truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bop_images import estimates_of, write_dataset
from graspcast.bop.dataset import BopDataset
from graspcast.errors import MismatchError, UnknownNameError
from graspcast.simulation.campaign.from_estimates import trials_from_estimates
from graspcast.simulation.grasps.table import GraspTable, ReferenceGrasp
from graspcast.simulation.objects.types import Grasp

HANDS = ("parallel", "underactuated")


@pytest.fixture
def dataset(tmp_path: Path) -> BopDataset:
    return write_dataset(tmp_path / "made")


def test_one_trial_for_each_estimate_and_gripper(dataset: BopDataset) -> None:
    tables = {name: estimates_of(dataset, seed) for seed, name in enumerate("ab")}
    requests = trials_from_estimates({"made": tables}, {"made": dataset}, HANDS)
    truth = dataset.ground_truth
    n = len(truth)
    assert len(requests.keys) == 2 * len(HANDS) * n
    assert requests.keys.is_unique().all()
    for row, obj_T_est in zip(requests.keys.rows(named=True), requests.obj_T_est, strict=True):
        (i,) = np.flatnonzero(
            (truth.scene_id == row["scene_id"])
            & (truth.im_id == row["im_id"])
            & (truth.obj_id == row["obj_id"])
        )
        # The true object, moved to its reference pose, takes the estimate with it.
        found = tables[row["estimator"]].cam_T_obj[i]
        np.testing.assert_allclose(truth.cam_T_obj[i] @ obj_T_est, found, atol=1e-12)


def test_what_is_left_out_is_counted(dataset: BopDataset) -> None:
    table = estimates_of(dataset)
    im_id = table.im_id.copy()
    im_id[0] = 99
    grasps = GraspTable([ReferenceGrasp(Grasp(np.eye(4), "made-5", "parallel"), "a test")])
    notes: list[str] = []
    results = {"made": {"a": replace(table, im_id=im_id, source="a_made-test.csv")}}
    requests = trials_from_estimates(results, {"made": dataset}, HANDS, grasps=grasps, notes=notes)
    assert set(requests.keys["obj_id"]) == {5} and set(requests.keys["gripper"]) == {"parallel"}
    assert notes == [
        "a_made-test.csv: 1 estimate has no ground truth",
        "left out 7 trials without a grasp: made-1 by parallel, made-1 by "
        "underactuated, made-5 by underactuated",
    ]
    with pytest.raises(MismatchError, match="both a ground truth and a grasp"):
        trials_from_estimates(results, {"made": dataset}, HANDS, grasps=GraspTable([]))


def test_each_estimate_guides_all_grasps_of_its_object(dataset: BopDataset) -> None:
    table = estimates_of(dataset)
    grasps = GraspTable(
        ReferenceGrasp(Grasp(np.eye(4), f"made-{number}", "parallel", name), "a test")
        for number, names in ((1, ("top", "side")), (5, ("reference",)))
        for name in names
    )
    found = trials_from_estimates(
        {"made": {"a": table}}, {"made": dataset}, ["parallel"], grasps=grasps
    )
    single = trials_from_estimates({"made": {"a": table}}, {"made": dataset}, ["parallel"])
    assert found.setups() == [
        ("made-1", "parallel", "top"),
        ("made-1", "parallel", "side"),
        ("made-5", "parallel", "reference"),
    ]
    for key in found.setups():
        rows = found.rows_of(*key)
        mine = single.rows_of(key[0], "parallel", "reference")
        np.testing.assert_array_equal(found.obj_T_est[rows], single.obj_T_est[mine])
    with pytest.raises(UnknownNameError, match="'made-1' by 'underactuated'; known: parallel"):
        trials_from_estimates(
            {"made": {"a": table}}, {"made": dataset}, HANDS, grasps=grasps, strict=True
        )
