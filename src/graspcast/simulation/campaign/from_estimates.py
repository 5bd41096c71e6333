"""Trial requests from estimates and ground truth.

The paper's change of frame (Section III-B) moves the true object to its reference pose, and the
estimate with it. A trial therefore needs only the relative pose ``inv(cam_T_gt) @ cam_T_est``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import polars as pl

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.errors import MismatchError
from graspcast.estimates.alignment import estimate_ids
from graspcast.estimates.matching import match
from graspcast.io.arguments import NAME, a, checked, mapping, sequence
from graspcast.io.wording import counted
from graspcast.pose.transforms import compose, invert
from graspcast.simulation.campaign.requests import TrialRequests
from graspcast.simulation.grasps.table import GraspTable

__all__ = ["trials_from_estimates"]


@checked(
    results=mapping(mapping(a(Results), "estimator"), "dataset"),
    datasets=mapping(a(BopDataset), "dataset"),
    grippers=sequence(NAME),
)
def trials_from_estimates(
    results: Mapping[str, Mapping[str, Results]],
    datasets: Mapping[str, BopDataset],
    grippers: Sequence[str],
    *,
    grasps: GraspTable | None = None,
    notes: list[str] | None = None,
) -> TrialRequests:
    """Return one trial for each estimate with a ground truth and each gripper.

    Parameters
    ----------
    results
        Dataset's name to estimator's name to results.
    datasets
        Dataset's name to its BOP directory, with ground truth.
    grippers
        Names of grippers.
    grasps
        If given, trials without a reference grasp are left out, and counted.
    notes
        Messages on what was left out are appended to it.

    Raises
    ------
    MismatchError
        If no trial is left, or no estimate of a file has a ground truth.
    """
    notes = [] if notes is None else notes
    keys, poses = [], []
    for name, tables in results.items():
        truth = datasets[name].ground_truth
        for estimator, table in tables.items():
            matched = match(table, truth)
            if without := int((matched < 0).sum()):
                notes.append(
                    f"{table.source}: {counted(without, 'estimate', 'has', 'have')} no ground truth"
                )
            rows = np.flatnonzero(matched >= 0)
            numbers = estimate_ids(table)
            for gripper in grippers:
                keys.append(
                    pl.DataFrame(
                        {
                            "scene_id": table.scene_id[rows],
                            "im_id": table.im_id[rows],
                            "obj_id": table.obj_id[rows],
                            "est_id": numbers[rows],
                        }
                    ).with_columns(
                        estimator=pl.lit(estimator),
                        dataset=pl.lit(name),
                        gripper=pl.lit(gripper),
                    )
                )
                true = truth.cam_T_obj[matched[rows]]
                poses.append(compose(invert(true), table.cam_T_obj[rows]))
    table_of_keys, obj_T_est = pl.concat(keys), np.concatenate(poses)
    without_grasp = ""
    if grasps is not None:
        pairs = table_of_keys.select(pl.format("{}-{}", "dataset", "obj_id"), "gripper").rows()
        has = np.array([pair in grasps for pair in pairs], dtype=bool)
        if not has.all():
            lacking = sorted({pairs[i] for i in np.flatnonzero(~has).tolist()})
            without_grasp = ", ".join(f"{name} by {gripper}" for name, gripper in lacking)
            left_out = int((~has).sum())
            notes.append(
                f"left out {counted(left_out, 'trial')} without a reference grasp: {without_grasp}"
            )
        table_of_keys, obj_T_est = table_of_keys.filter(has), obj_T_est[has]
    if not len(table_of_keys):
        raise MismatchError(
            "no estimate has both a ground truth and a reference grasp"
            + (f"; write grasps of {without_grasp} in a TOML file" if without_grasp else ""),
            parameters=("estimates", "grasps"),
        )
    return TrialRequests(table_of_keys, obj_T_est)
