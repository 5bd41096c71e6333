"""Outcomes of the grasps that estimates guided, joined with their instances."""

from __future__ import annotations

from collections import Counter

import numpy as np
import polars as pl
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import Instances
from graspcast.estimates.outcomes import REFERENCE_GRASP, errors_of_each, success_of_each

__all__ = ["check_gripper", "join_grasps", "outcomes_of"]


def join_grasps(
    estimates: Estimates, outcomes: pl.DataFrame, principal: str, gripper: str
) -> tuple[dict[str, Float[ndarray, "k n"]], Float[ndarray, "k n 4 4"]]:
    """Join estimates with the outcomes of each grasp that they guided.

    Parameters
    ----------
    estimates
        Poses of n instances by K estimators.
    outcomes
        As :func:`graspcast.estimates.outcomes.checked_outcomes` returns them.
    principal
        The estimator by whose scores the instances are numbered.
    gripper
        The gripper.

    Returns
    -------
        Grasp's name, sorted, to the outcomes of the grasps that each estimator guided, NaN where
        not tried; and the error that guided each, where the outcomes state it. It is the same for
        all grasps.

    Raises
    ------
    MismatchError
        Where it is not clear which of several instances an outcome is of.
    """
    mine = outcomes.filter(
        pl.col("gripper") == gripper, pl.col("estimator").is_in(list(estimates.estimators))
    )
    errors = np.full((len(estimates.estimators), len(estimates), 4, 4), np.nan)
    held: dict[str, ndarray] = {}
    for grasp in mine["grasp"].unique().sort():
        some = mine.filter(pl.col("grasp") == grasp)
        found = [
            outcomes_of(estimates, some, name, gripper, numbered=name == principal, grasp=grasp)
            for name in estimates.estimators
        ]
        held[grasp] = np.stack([success for success, _ in found])
        errors = np.where(np.isnan(errors), np.stack([stated for _, stated in found]), errors)
        own = held[grasp][estimates.index(principal)]
        _check_numbering(estimates, some, principal, own)
    return held, errors


def outcomes_of(
    estimates: Estimates,
    outcomes: pl.DataFrame,
    name: str,
    gripper: str,
    *,
    numbered: bool,
    grasp: str = REFERENCE_GRASP,
) -> tuple[Float[ndarray, " n"], Float[ndarray, "n 4 4"]]:
    """Return the outcomes of the grasps that an estimator guided, and the errors that they state.

    Parameters
    ----------
    estimates
        The instances.
    outcomes
        As :func:`graspcast.estimates.outcomes.checked_outcomes` returns them.
    name, gripper
        The estimator and the gripper.
    grasp
        Which of the grasps.
    numbered
        Whether the instances are numbered by its scores. If not, only the outcomes of objects that
        appear once in the image are used.
    """
    success = np.full(len(estimates), np.nan)
    errors = np.full((len(estimates), 4, 4), np.nan)
    rows = np.arange(len(estimates))
    if not numbered:
        rows = np.flatnonzero(_is_alone(estimates))
        image = ["dataset", "scene_id", "im_id", "obj_id"]
        outcomes = outcomes.filter(pl.col("est_id").fill_null(0).max().over(image) == 0)
    mine = estimates.instances.select(rows)
    incomplete = Instances.of([gap.key for gap in estimates.incomplete])
    given = mine, outcomes, name, gripper
    success[rows] = success_of_each(*given, grasp=grasp, others=incomplete)
    errors[rows] = errors_of_each(*given, grasp=grasp)
    return success, errors


def _is_alone(estimates: Estimates) -> Bool[ndarray, " n"]:
    """Find the instances of which no estimator has another one of the object in the image."""
    if estimates.alone is not None:
        return estimates.alone
    keys = [gap.key for gap in estimates.incomplete] + estimates.instances.to_keys()
    count = Counter(key[:4] for key in keys)
    return np.array([count[key[:4]] == 1 for key in estimates.instances.to_keys()], dtype=bool)


def _check_numbering(
    estimates: Estimates, outcomes: pl.DataFrame, principal: str, success: Float[ndarray, " n"]
) -> None:
    """Raise where outcomes of a former version number instances of equal score by file order.

    Raises
    ------
    MismatchError
        Naming the first such instance.
    """
    if estimates.tied is None or "inst_id" not in outcomes.columns:
        return
    former = outcomes.filter(pl.col("inst_id").is_not_null(), pl.col("estimator") == principal)
    tied = np.flatnonzero(estimates.tied & ~np.isnan(success))
    if len(former) and len(tied):
        key = estimates.instances.to_keys()[int(tied[0])]
        raise MismatchError(
            f"{key}: {principal} gave several estimates there the same score, and inst_id, of a "
            "former version, numbers those by their place in a file, so their outcomes cannot be "
            "assigned; number the trials by est_id (equal scores by pose, nearest first), or "
            "simulate again",
            parameters=("outcomes",),
        )


def check_gripper(outcomes: pl.DataFrame, gripper: str) -> None:
    """Raise unless a table has the columns of outcomes, and outcomes of a gripper.

    Raises
    ------
    InputError
        For other columns.
    UnknownNameError
        For a gripper without outcomes.
    """
    needed = ("estimator", "dataset", "scene_id", "im_id", "obj_id", "gripper", "success")
    if missing := [name for name in needed if name not in outcomes.columns]:
        raise InputError(
            f"the outcomes lack {', '.join(missing)}; read_outcomes reads one from a file",
            parameters=("outcomes",),
        )
    grippers = outcomes["gripper"].unique().sort().to_list()
    if gripper not in grippers:
        raise UnknownNameError(
            "gripper", gripper, grippers, hint="These have outcomes", parameters=("gripper",)
        )
