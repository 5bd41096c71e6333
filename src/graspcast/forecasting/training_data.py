"""Training data: estimates with outcomes, and where known ground truth and simulated trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.outcomes import REFERENCE_GRASP, checked_outcomes
from graspcast.estimates.selection import listed
from graspcast.forecasting.learned_outcomes import LearnedOutcomes, check_names
from graspcast.forecasting.outcome_joining import check_gripper, join_grasps
from graspcast.forecasting.simulated_trials import SimulatedTrials
from graspcast.forecasting.view_data import ViewData
from graspcast.io.arguments import NAME, a, checked

__all__ = ["ONE_GRASP", "TrainingData"]

ONE_GRASP = (
    "outcomes of estimators that are not there at run time are learned from where objects have "
    "the reference grasp alone"
)
"""Why they are not, for a message."""


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
        Outcomes of the reference grasps that each estimator guided: 1, 0, or NaN where not tried,
        (K, n), in the estimators' order.
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
    others
        Name of each further grasp that was tried, sorted, to its outcomes, as ``success``, (K, n).
        A grasp of one object has nothing to do with one of the same name of another object.
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
    others: Mapping[str, Float[ndarray, "k n"]] = field(default_factory=dict)

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
        others: dict[str, ndarray] = {}
        if outcomes is not None:
            check_gripper(outcomes, gripper)
            given = estimates, checked_outcomes(outcomes), principal, gripper
            others, errors = join_grasps(*given)
            success = others.pop(REFERENCE_GRASP, success)
            others = {name: held for name, held in others.items() if not np.isnan(held).all()}
        if truth is None:
            truth = np.full((len(estimates), 4, 4), np.nan)
        data = cls(estimates, principal, gripper, truth, success, simulated, errors, others=others)
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
        """Outcomes of the reference grasps that the principal guided, NaN where not tried."""
        return self.success[self.estimates.index(self.principal)]

    @property
    def grasps(self) -> tuple[str, ...]:
        """Names of the grasps that were tried, the reference grasp first."""
        tried = not self.others or not np.isnan(self.success).all()
        return (*([REFERENCE_GRASP] if tried else []), *self.others)

    @property
    def every_success(self) -> Float[ndarray, "s k n"]:
        """Outcomes of all grasps, in the order of :attr:`grasps`, (S, K, n)."""
        named = {REFERENCE_GRASP: self.success, **self.others}
        return np.stack([named[name] for name in self.grasps])

    @property
    def own_outcomes(self) -> Float[ndarray, "s n"]:
        """Outcomes of all grasps that the principal guided, NaN where not tried, (S, n)."""
        return self.every_success[:, self.estimates.index(self.principal)]

    @property
    def is_tried(self) -> Bool[ndarray, " n"]:
        """Which instances have an outcome of a grasp that the principal guided."""
        return np.asarray(~np.isnan(self.own_outcomes).all(axis=0))

    def outcome_of(self, grasps: Sequence[str]) -> Float[ndarray, " n"]:
        """Return the outcome of one grasp of each instance that the principal guided.

        Parameters
        ----------
        grasps
            The grasp's name for each instance.
        """
        row = {name: i for i, name in enumerate(self.grasps)}
        own, out = self.own_outcomes, np.full(len(self), np.nan)
        for i, name in enumerate(grasps):
            if name in row:
                out[i] = own[row[name], i]
        return out

    def refuse_several(self, why: str, *parameters: str) -> None:
        """Raise if other than reference grasps were tried.

        Raises
        ------
        InputError
            Saying why, and which grasps there are.
        """
        if self.others:
            raise InputError(
                f"{why}, but there are outcomes of the grasps {', '.join(self.grasps)}",
                parameters=parameters,
            )

    def of_grasp(self, name: str = REFERENCE_GRASP) -> TrainingData:
        """Return the data of one grasp of each object alone, as that of the reference grasp.

        Raises
        ------
        UnknownNameError
            If it was never tried.
        """
        if name not in self.grasps:
            raise UnknownNameError(
                "grasp", name, self.grasps, hint="These have outcomes", parameters=("outcomes",)
            )
        success = self.success if name == REFERENCE_GRASP else self.others[name]
        return replace(self, success=success, others={})

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
            others={name: held[:, which] for name, held in self.others.items()},
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
        self.refuse_several(ONE_GRASP, "learn_from")
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
            others={name: held[rows] for name, held in self.others.items()},
            obj_T_est=None if self.obj_T_est is None else self.obj_T_est[rows],
            views=self.views if set(estimators) == set(self.estimates.estimators) else None,
        )
