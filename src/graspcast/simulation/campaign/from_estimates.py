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
    strict: bool = False,
    notes: list[str] | None = None,
) -> TrialRequests:
    """Return one trial for each estimate with a ground truth, each gripper and each grasp.

    Parameters
    ----------
    results
        Dataset's name to estimator's name to results.
    datasets
        Dataset's name to its BOP directory, with ground truth.
    grippers
        Names of grippers.
    grasps
        The grasps; each estimate guides all of them. Trials without one are left out, and
        counted. If None, each guides the reference grasp.
    strict
        Whether a missing grasp is an error.
    notes
        Messages on what was left out are appended to it.

    Raises
    ------
    MismatchError
        If no trial is left, or no estimate of a file has a ground truth.
    UnknownNameError
        If ``strict``, and there is no grasp of an object by a gripper.
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
    lacking = ""
    if grasps is not None:
        table_of_keys, lacking = _with_grasps(table_of_keys, grasps, strict)
        left_out = len(obj_T_est) - table_of_keys["row"].n_unique()
        if lacking:
            notes.append(f"left out {counted(left_out, 'trial')} without a grasp: {lacking}")
        obj_T_est = obj_T_est[table_of_keys["row"].to_numpy()]
        table_of_keys = table_of_keys.drop("row")
    if not len(table_of_keys):
        raise MismatchError(
            "no estimate has both a ground truth and a grasp"
            + (f"; graspcast propose-grasps finds grasps of {lacking}" if lacking else ""),
            parameters=("estimates", "grasps"),
        )
    return TrialRequests(table_of_keys, obj_T_est)


def _with_grasps(keys: pl.DataFrame, grasps: GraspTable, strict: bool) -> tuple[pl.DataFrame, str]:
    """Return the keys once for each grasp, with their ``row``, and which pairs have no grasp."""
    keys = keys.with_columns(object=pl.format("{}-{}", "dataset", "obj_id")).with_row_index("row")
    pairs = keys.select("object", "gripper").unique(maintain_order=True).rows()
    named = {
        pair: [reference.grasp.name for reference in grasps.of(*pair)]
        for pair in pairs
        if strict or pair in grasps
    }
    names = pl.DataFrame(
        [(*pair, name) for pair, some in named.items() for name in some],
        schema={"object": pl.String, "gripper": pl.String, "grasp": pl.String},
        orient="row",
    )
    joined = keys.join(names, on=["object", "gripper"], how="inner", maintain_order="left_right")
    lacking = sorted(set(pairs) - set(named))
    return joined.drop("object"), ", ".join(f"{name} by {gripper}" for name, gripper in lacking)
