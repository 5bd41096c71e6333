"""Training data: estimates with outcomes, and where known ground truth and simulated trials."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from os import PathLike

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import Instances
from graspcast.estimates.outcomes import (
    checked_outcomes,
    errors_of_each,
    read_error_outcomes,
    success_of_each,
)
from graspcast.estimates.selection import listed
from graspcast.forecasting.learned_outcomes import LearnedOutcomes, check_names
from graspcast.forecasting.view_data import ViewData
from graspcast.io.arguments import NAME, PATH, a, checked, refuse_unless, sequence

__all__ = ["SimulatedTrials", "TrainingData", "outcomes_of"]


@dataclass(frozen=True, eq=False)
class SimulatedTrials:
    """Simulated trials of one gripper, each with the pose error that guided it.

    Attributes
    ----------
    objects
        ``dataset-number`` of each trial's object, (n,).
    obj_T_est
        Pose errors, ``inv(cam_T_true) @ cam_T_est``, metres, (n, 4, 4).
    success
        Outcomes, (n,).
    """

    objects: ndarray
    obj_T_est: Float[ndarray, "n 4 4"]
    success: Bool[ndarray, " n"]

    def __repr__(self) -> str:
        return f"SimulatedTrials({len(self)} of {len(set(self.objects.tolist()))} objects)"

    def __len__(self) -> int:
        return len(self.success)

    @classmethod
    def read(cls, paths: Iterable[str | PathLike[str]], gripper: str) -> SimulatedTrials:
        """Read the trials of a gripper from one or more campaigns.

        Raises
        ------
        FormatError
            Naming the file that is wrong.
        MismatchError
            If there are none of this gripper.
        """
        paths = list(paths) if isinstance(paths, Iterable) and not isinstance(paths, str) else paths
        some = (lambda given: bool(given) and sequence(PATH)[0](given), "a list of paths")
        refuse_unless(some, paths, "SimulatedTrials.read", "paths")
        tables, errors = zip(*(read_error_outcomes(path) for path in paths), strict=True)
        table = pl.concat(tables)
        mine = (table["gripper"] == gripper).to_numpy()
        if not mine.any():
            available = ", ".join(table["gripper"].unique().sort().to_list())
            raise MismatchError(
                f"no simulated trial of the {gripper} gripper; there are trials of {available}",
                parameters=("gripper", "simulated"),
            )
        return cls(
            table["object"].to_numpy().astype(str)[mine],
            np.concatenate(errors)[mine],
            table["success"].to_numpy()[mine],
        )

    def select(self, which: Bool[ndarray, " n"]) -> SimulatedTrials:
        """Select trials by mask."""
        return SimulatedTrials(self.objects[which], self.obj_T_est[which], self.success[which])


@dataclass(frozen=True, eq=False)
class TrainingData:
    """Instances with the outcomes of grasping them, for one principal and gripper.

    Attributes
    ----------
    estimates
        Poses of n instances by K estimators.
    principal
        The estimator whose grasps are to be forecast.
    gripper
        The gripper.
    truth
        True poses ``cam_T_obj``, metres, NaN where unknown, (n, 4, 4).
    success
        Outcomes of the grasps that each estimator guided: 1, 0, or NaN where not tried, (K, n), in
        the estimators' order.
    simulated
        Simulated trials of the gripper, or None.
    obj_T_est
        The error that guided each of these grasps, ``inv(cam_T_gt) @ cam_T_est``, where the
        outcomes state it (a campaign's do), NaN elsewhere, (K, n, 4, 4), or None. Where it is not
        stated it is derived from the true poses.
    views
        Poses of these instances fused from several views, or None.
    learned
        Outcomes of further estimators, which are learned from but not needed at run time, or None
        (:meth:`learning_from`).
    """

    estimates: Estimates
    principal: str
    gripper: str
    truth: Float[ndarray, "n 4 4"]
    success: Float[ndarray, "k n"]
    simulated: SimulatedTrials | None = None
    obj_T_est: Float[ndarray, "k n 4 4"] | None = None
    views: ViewData | None = None
    learned: LearnedOutcomes | None = None

    @classmethod
    @checked(
        estimates=a(Estimates),
        outcomes=a(pl.DataFrame, type(None), words="a table, or None"),
        principal=NAME,
        gripper=NAME,
    )
    def join(
        cls,
        estimates: Estimates,
        outcomes: pl.DataFrame | None,
        principal: str,
        gripper: str,
        *,
        truth: Float[ndarray, "n 4 4"] | None = None,
        simulated: SimulatedTrials | None = None,
    ) -> TrainingData:
        """Join estimates with outcomes, and where known with ground truth and simulated trials.

        Detections of several instances of an object in an image are numbered by the principal's
        scores, so the other estimators' outcomes are used only where an object appears once.

        Parameters
        ----------
        estimates
            Poses by K estimators.
        outcomes
            As :func:`graspcast.estimates.outcomes.read_outcomes` returns them, or None.
        principal
            The estimator whose grasps are to be forecast.
        gripper
            The gripper.
        truth
            ``cam_T_obj``, NaN where unknown (:func:`graspcast.estimates.matching.true_poses`).
        simulated
            Simulated trials of the gripper.

        Raises
        ------
        UnknownNameError
            For a principal or gripper that is not there.
        MismatchError
            If there are outcomes, but no instance has one of the principal.
        """
        estimates.index(principal)
        success = np.full((len(estimates.estimators), len(estimates)), np.nan)
        errors = np.full((*success.shape, 4, 4), np.nan)
        if outcomes is not None:
            _check_gripper(outcomes, gripper)
            outcomes = checked_outcomes(outcomes)
            for k, name in enumerate(estimates.estimators):
                given = estimates, outcomes, name, gripper
                success[k], errors[k] = outcomes_of(*given, numbered=name == principal)
            _check_numbering(estimates, outcomes, principal, success[estimates.index(principal)])
        if truth is None:
            truth = np.full((len(estimates), 4, 4), np.nan)
        data = cls(estimates, principal, gripper, truth, success, simulated, errors)
        if outcomes is not None and not data.is_tried.any():
            groups = outcomes.group_by("estimator", "dataset").agg("obj_id", "scene_id")
            pairs = ", ".join(
                f"{e} on {d} (objects {listed(numbers)}, scenes {listed(scenes)})"
                for e, d, numbers, scenes in groups.sort("estimator", "dataset").rows()
            )
            raise MismatchError(
                f"{data._untried}; there are outcomes of {pairs or 'nothing'}",
                parameters=("outcomes", "principal"),
            )
        return data

    def __repr__(self) -> str:
        more = ""
        if self.learned is not None:
            more = f", also learned from {', '.join(self.learned.estimators)}"
        return (
            f"TrainingData({len(self)} instances, {int(self.is_tried.sum())} with outcomes, "
            f"{int(self.has_truth.sum())} with true poses; principal {self.principal}, "
            f"{self.gripper} gripper{more})"
        )

    def __len__(self) -> int:
        return len(self.estimates)

    @property
    def objects(self) -> ndarray:
        """``dataset-number`` of each instance's object, (n,)."""
        return self.estimates.objects

    @property
    def has_truth(self) -> Bool[ndarray, " n"]:
        """Which instances' true poses are known."""
        return np.isfinite(self.truth).all(axis=(1, 2))

    @property
    def own_success(self) -> Float[ndarray, " n"]:
        """Outcomes of the grasps that the principal guided: 1, 0, or NaN where not tried."""
        return self.success[self.estimates.index(self.principal)]

    @property
    def is_tried(self) -> Bool[ndarray, " n"]:
        """Which instances have an outcome of a grasp that the principal guided."""
        return ~np.isnan(self.own_success)

    @property
    def _untried(self) -> str:
        return f"no instance has an outcome of {self.principal} with the {self.gripper} gripper"

    def tried(self) -> TrainingData:
        """Select the instances on which a grasp guided by the principal was tried.

        Raises
        ------
        MismatchError
            If there are none.
        """
        is_tried = self.is_tried
        if not is_tried.any():
            raise MismatchError(self._untried, parameters=("outcomes",))
        return self.select(is_tried)

    def select(self, which: Bool[ndarray, " n"] | Int[ndarray, " m"]) -> TrainingData:
        """Select instances by mask or number; all simulated trials stay."""
        return replace(
            self,
            estimates=self.estimates.select(which),
            truth=self.truth[which],
            success=self.success[:, which],
            obj_T_est=None if self.obj_T_est is None else self.obj_T_est[:, which],
            views=None if self.views is None else self.views.select(which, len(self)),
            learned=None if self.learned is None else self.learned.select(which),
        )

    def learning_from(self, *estimators: str) -> TrainingData:
        """Keep the outcomes of some estimators for learning, without needing them at run time.

        Success given error is then learned from the grasps that they guided as well. The forecaster
        needs the estimates of the others alone.

        Raises
        ------
        InputError
            If the principal is among them.
        UnknownNameError
            For one that is not there.
        MismatchError
            If :attr:`views` are fused from other than the remaining estimators.
        """
        check_names(estimators, self.principal, self.estimates.estimators)
        if not estimators:
            return self
        kept = tuple(name for name in self.estimates.estimators if name not in estimators)
        if self.views is not None and set(self.views.estimators) != set(kept):
            raise MismatchError(
                f"poses are fused from {', '.join(self.views.estimators)}, but {', '.join(kept)} "
                "alone will be there at run time: fuse from these, or learn from others",
                parameters=("learn_from",),
            )
        names = tuple(sorted(set(estimators)))
        rows = [self.estimates.index(name) for name in names]
        stated = None if self.obj_T_est is None else self.obj_T_est[rows]
        given = (names, self.estimates.cam_T_obj[rows], self.success[rows], stated)
        learned = LearnedOutcomes(*given)
        if self.learned is not None:
            learned = self.learned.joined(learned)
        return replace(self.only(*kept), views=self.views, learned=learned)

    def only(self, *estimators: str) -> TrainingData:
        """Return the data without the poses and outcomes of all other estimators.

        Poses fused from others too are left out.

        Raises
        ------
        UnknownNameError
            For one that is not there.
        MismatchError
            If the principal is not among them.
        """
        if self.principal not in estimators:
            raise MismatchError(
                f"{self.principal} is the principal, but not among {', '.join(estimators)}"
            )
        rows = [self.estimates.index(name) for name in estimators]
        return replace(
            self,
            estimates=self.estimates.only(*estimators),
            success=self.success[rows],
            obj_T_est=None if self.obj_T_est is None else self.obj_T_est[rows],
            views=self.views if set(estimators) == set(self.estimates.estimators) else None,
        )


def outcomes_of(
    estimates: Estimates, outcomes: pl.DataFrame, name: str, gripper: str, *, numbered: bool
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
    success[rows] = success_of_each(mine, outcomes, name, gripper, others=incomplete)
    errors[rows] = errors_of_each(mine, outcomes, name, gripper)
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


def _check_gripper(outcomes: pl.DataFrame, gripper: str) -> None:
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
