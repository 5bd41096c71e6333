"""The forecaster: from K estimators' poses of an instance to the probability of grasp success."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.forecasting.attribution import attributions
from graspcast.forecasting.features import Features, features_of
from graspcast.forecasting.frame_verdicts import predict_frame as _predict_frame
from graspcast.forecasting.grasp_ranking import Reachable
from graspcast.forecasting.grasps_of_instances import rank as _rank
from graspcast.forecasting.grasps_of_instances import ranking_of as _ranking_of
from graspcast.forecasting.grasps_of_instances import rankings as _rankings
from graspcast.forecasting.known_objects import KnownObjects
from graspcast.forecasting.known_objects import with_objects as _with_objects
from graspcast.forecasting.model_card import ONE_VIEW_FEATURES, ModelCard
from graspcast.forecasting.model_file import read_model, write_model
from graspcast.forecasting.models.base import Predictor
from graspcast.forecasting.models.blend import Blend, visibility_of
from graspcast.forecasting.models.view_model import ViewModel
from graspcast.forecasting.models.visibility import Visibility
from graspcast.forecasting.novelty import OOD_ALPHA, Disagreement, Novelty
from graspcast.forecasting.pose_checks import (
    ARGUMENTS,
    alone_problems,
    estimate_problems,
    estimates_of_one,
    sane_of,
)
from graspcast.forecasting.sane_verdicts import decide_sane as _decide_sane
from graspcast.forecasting.verdict import Verdict, check_threshold
from graspcast.forecasting.view_verdicts import judge as _judge
from graspcast.forecasting.visibility_features import features_of_one, seen_of
from graspcast.forecasting.warm_up import warm_up as _warm_up
from graspcast.io.arguments import checked

__all__ = ["Forecaster"]


@checked(**ARGUMENTS)
@dataclass(frozen=True, eq=False)
class Forecaster:
    """A trained model of grasp success, a novelty detector, and the model card.

    ::

        forecaster = Forecaster.load("model.npz")
        verdict = forecaster.predict({"epos": cam_T_a, "gdrnpp": cam_T_b}, "lmo-1")
        if verdict.attempt: ...
    """

    card: ModelCard
    predictor: Predictor
    novelty: Novelty | None
    """None for a single estimator that is not forecast from one view."""
    typical: Float[ndarray, " d"]
    """Medians of the training features, the baseline of attributions."""
    others: tuple[Forecaster, ...] = ()
    """The same for other guides, with the same forests."""
    known: KnownObjects | None = None
    """What the model file carries of the objects; None if it was written without."""

    warm_up = _warm_up
    predict_frame = _predict_frame
    rank = _rank
    judge = _judge
    with_objects = _with_objects
    _decide = _decide_sane

    def __repr__(self) -> str:
        card = self.card
        together = f"with {', '.join(card.supporters)}" if card.supporters else "alone"
        return (
            f"Forecaster({card.method}: {card.principal} {together}; "
            f"{card.gripper} gripper, {len(card.objects)} objects, {card.samples} samples)"
        )

    @property
    def guides(self) -> tuple[str, ...]:
        """The estimators that may guide the grasp, the principal first."""
        return (self.card.principal, *(other.card.principal for other in self.others))

    def guided_by(self, guide: str) -> Forecaster:
        """Return the forecaster of grasps that another estimator guides.

        Raises
        ------
        UnknownNameError
            For an estimator that may not guide: training had too few outcomes of its grasps.
        """
        if guide == self.card.principal:
            return self
        every = (self, *self.others)
        for other in self.others:
            if other.card.principal == guide:
                rest = (replace(each, others=()) for each in every if each is not other)
                return replace(other, others=tuple(rest))
        raise UnknownNameError("guide", guide, self.guides, parameters=("guide",))

    @property
    def view_model(self) -> ViewModel | None:
        """The model of success with several views; None if it was trained without."""
        return self.predictor.views if isinstance(self.predictor, Blend) else None

    @property
    def visibility(self) -> Visibility | None:
        """The model of one view of one estimator; None if there are supporters."""
        return visibility_of(self.predictor)

    @property
    def needs_models(self) -> bool:
        """Whether its features need object models."""
        return self.card.features not in ("paper", ONE_VIEW_FEATURES)

    def models_or(self, models: Mapping[str, Models] | None = None) -> Mapping[str, Models] | None:
        """Return object models; those that the model file carries if None."""
        return self.known.models if models is None and self.known is not None else models

    def probability(
        self,
        estimates: Estimates,
        models: Mapping[str, Models] | None = None,
        *,
        unseen_objects: bool = False,
        grasp: str | None = None,
    ) -> Float[ndarray, " n"]:
        """Forecast the probability of success of every instance.

        Where the forecaster knows several grasps, it is that of the best (:meth:`rank`).

        Parameters
        ----------
        estimates
            Poses by (at least) the principal and the supporters.
        models
            Dataset's name to its object models; those that the model file carries if None.
        unseen_objects
            Also forecast objects that are not in training, if the method can.
        grasp
            Of this grasp instead of the best.

        Returns
        -------
            NaN where there is no forecast: the pose by some estimator is not sane
            (:mod:`graspcast.pose.sanity`), or two are given one and the same pose.

        Raises
        ------
        MismatchError
            For other estimators or objects than it was trained for, or objects of other sizes.
        UnknownNameError
            For a grasp that it does not know.
        """
        one = None if grasp is None else (lambda key: (grasp,))
        return _rankings(self, estimates, models, one, unseen_objects).probability

    def p_value(self, estimates: Estimates) -> Float[ndarray, " n"]:
        """Compute the novelty p-value of every instance (:mod:`graspcast.forecasting.novelty`).

        Small means novel: of instances of scenes like those in training, at most a share ``a`` has
        a p-value of ``a`` or less. NaN where :meth:`probability` is, and for a single estimator.

        Raises
        ------
        MismatchError
            For other estimators than it was trained for.
        """
        return np.array([given.p_value for given in self.disagreements(estimates)], np.float64)

    def disagreements(self, estimates: Estimates) -> list[Disagreement]:
        """Assess how unusual the estimators' disagreement on every instance is.

        Where the pose by some estimator is not sane, it is novel, with the reason in ``excess``.

        Raises
        ------
        MismatchError
            For other estimators than it was trained for.
        """
        problems = self._pose_problems(estimates, None)
        if not any(problems):
            return self._disagreements(estimates)
        sane = sane_of(problems)
        found = iter(self._disagreements(estimates.select(sane)) if sane.any() else [])
        smallest = self.card.smallest_p_value
        return [Disagreement(np.nan, smallest, why) if why else next(found) for why in problems]

    def _disagreements(self, estimates: Estimates) -> list[Disagreement]:
        card = self.card
        assert self.novelty is not None
        diameter_m = card.diameters_of(estimates.objects)
        return self.novelty.assess(estimates, card.principal, card.supporters, diameter_m)

    def explain(
        self, estimates: Estimates, models: Mapping[str, Models] | None = None
    ) -> list[tuple[tuple[str, float], ...]]:
        """Attribute every forecast to groups of features, the largest magnitude first.

        The attribution of a group (for example one supporter's rotation) is the forecast less the
        forecast with the group set to its medians in training. There is none where
        :meth:`probability` is NaN.

        Raises
        ------
        MismatchError
            As :meth:`probability`.
        """
        problems = self._pose_problems(estimates, models)
        self.card.numbers_of(estimates.objects.tolist())
        if not (sane := sane_of(problems)).any():
            return [() for _ in problems]
        some = estimates.select(sane)
        inputs, numbers = self._inputs(some, models)
        if self.card.grasps:
            numbers = _ranking_of(self, inputs, some, numbers, None).targets
        found = iter(attributions(self.predictor, inputs, numbers, self.typical))
        return [() if why else next(found) for why in problems]

    def verdicts(
        self,
        estimates: Estimates,
        models: Mapping[str, Models] | None = None,
        *,
        threshold: float | None = 0.5,
        guarantee: str | None = None,
        ood_alpha: float = OOD_ALPHA,
        explain: bool = False,
        reachable: Reachable | None = None,
    ) -> list[Verdict]:
        """Decide on every instance: attempt the grasp, or abstain.

        Abstain where the pose by some estimator is not sane (:mod:`graspcast.pose.sanity`), and
        from objects that are not in training. Of several grasps the verdict is on the best.

        Parameters
        ----------
        estimates, models
            As for :meth:`probability`.
        threshold
            Attempt at this probability or above it; None attempts nothing.
        guarantee
            The guarantee that the threshold was certified for.
        ood_alpha
            Abstain where :meth:`p_value` is this or less; 0 accepts any p-value. A disagreement
            larger than in training is always abstained from.
        explain
            Add attributions (see :meth:`explain`).
        reachable
            As for :meth:`rank`; abstain where nothing is reachable.

        Raises
        ------
        MismatchError
            For other estimators than it was trained for, if it was trained for none of the
            objects, or if objects have other sizes than in training.
        UnknownNameError
            For a reachable grasp that it does not know.
        """
        problems = self._problems(estimates, models)
        options: dict[str, Any] = {"threshold": threshold, "guarantee": guarantee}
        options |= {"ood_alpha": ood_alpha, "explain": explain, "reachable": reachable}
        if not any(problems):
            return self._decide(estimates, models, **options)
        sane = sane_of(problems)
        decided = self._decide(estimates.select(sane), models, **options) if sane.any() else []
        found = iter(decided)
        return [Verdict(False, None, why) if why else next(found) for why in problems]

    def _problems(self, estimates: Estimates, models: Mapping[str, Models] | None) -> list[str]:
        """Say for each instance why there is no forecast, or nothing."""
        self.card.check_estimators(estimates.estimators)
        known = set(self.card.objects)
        if not known.intersection(estimates.objects.tolist()):
            self.card.numbers_of(estimates.objects.tolist())
        problems = self._pose_problems(estimates, models)
        return [
            why if name in known else f"the model was not trained for {name}"
            for name, why in zip(estimates.objects.tolist(), problems, strict=True)
        ]

    def _pose_problems(
        self, estimates: Estimates, models: Mapping[str, Models] | None
    ) -> list[str]:
        """Say for each instance which poses are not sane, or copies, or nothing."""
        self.card.check_estimators(estimates.estimators)
        found = estimate_problems(estimates.only(*self.card.estimators), models, self.card)
        if self.card.supporters:
            return found
        numbers = self.card.numbers_of(estimates.objects.tolist(), unseen=True)
        tried = None if self.visibility is None else self.card.targets.any_of(self.visibility.tried)
        alone = alone_problems(tried, estimates.objects, numbers)
        return [why or other for why, other in zip(found, alone, strict=True)]

    def predict(
        self,
        poses: Mapping[str, Float[ndarray, "4 4"] | None],
        object_name: str,
        *,
        threshold: float = 0.5,
        models: Mapping[str, Models] | None = None,
        ood_alpha: float = OOD_ALPHA,
        explain: bool = False,
        score: float | None = None,
        image_fit: Features | None = None,
        reachable: Collection[str] | None = None,
    ) -> Verdict:
        """Decide on one instance: attempt the grasp, or abstain.

        Parameters
        ----------
        poses
            Estimator's name to its ``cam_T_obj``, metres; None where it found nothing. Where one is
            None or not sane (:mod:`graspcast.pose.sanity`), or two estimators are given one and the
            same pose, the verdict is to abstain, as by :meth:`verdicts`.
        object_name
            ``dataset-number``, as in ``lmo-1``.
        threshold
            Attempt at this probability or above it.
        models
            As for :meth:`probability`.
        ood_alpha, explain
            As for :meth:`verdicts`.
        score, image_fit
            Of a single estimator's pose, if known
            (:attr:`graspcast.rendering.image_fit.ImageFit.features`); with supporters neither
            makes a difference.
        reachable
            Names of the grasps that the robot can reach; all if None. The verdict is on the best of
            them, and :attr:`Verdict.grasps` ranks them.

        Raises
        ------
        MismatchError
            For other estimators or objects than it was trained for, or an object of another size.
        InputError
            For what is not a 4x4 matrix of numbers, or a threshold outside [0, 1].
        UnknownNameError
            For a reachable grasp that it does not know.
        """
        check_threshold(threshold)
        self.card.check_estimators(poses)
        self.card.numbers_of([object_name])
        mine = {name: poses[name] for name in self.card.estimators}
        estimates = estimates_of_one(mine, object_name, seen_of(score, image_fit))
        (problem,) = self._pose_problems(estimates, models)
        if problem:
            return Verdict(False, None, problem)
        (verdict,) = self._decide(
            estimates,
            models,
            threshold=threshold,
            guarantee=None,
            ood_alpha=ood_alpha,
            explain=explain,
            reachable=reachable,
        )
        return verdict

    def _inputs(
        self, estimates: Estimates, models: Mapping[str, Models] | None, unseen: bool = False
    ) -> tuple[Features, ndarray]:
        """Compute the inputs of the model: each instance's features and object number."""
        card = self.card
        self.card.check_estimators(estimates.estimators)
        mine = estimates.only(*card.estimators)
        if self.visibility is not None:
            found = features_of_one(mine, self.visibility.names)
        else:
            found = features_of(mine, card.principal, card.features, self.models_or(models))
        return found, self.card.numbers_of(estimates.objects.tolist(), unseen)

    def save(self, path: str | PathLike[str]) -> None:
        """Write one npz file of arrays and JSON, without pickle, with a digest."""
        every = (self, *self.others)
        parts = [(f.card, f.predictor, f.novelty, f.typical) for f in every]
        write_model(path, parts, self.known)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Forecaster:
        """Read a file that :meth:`save` wrote.

        Raises
        ------
        FormatError
            If the file is missing, damaged, or not a model.
        """
        every, known = read_model(path)
        first, *rest = (cls(*parts, known=known) for parts in every)
        return replace(first, others=tuple(rest))
