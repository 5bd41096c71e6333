"""Training of a forecaster."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import TrainingDataWarning, UnknownNameError
from graspcast.estimates.checks import diameters
from graspcast.estimates.instances import split_object_name, unit_names
from graspcast.forecasting.features import FeatureSet, features_of
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.grasp_counts import grasp_counts, rarely_tried
from graspcast.forecasting.model_card import ONE_VIEW_FEATURES, ModelCard, digest_of
from graspcast.forecasting.model_file import KINDS
from graspcast.forecasting.models.add_threshold import Thresholds
from graspcast.forecasting.models.base import Predictor
from graspcast.forecasting.models.blend import Blend, ForestSettings, visibility_of
from graspcast.forecasting.models.growing import grow_blends
from graspcast.forecasting.models.mlp.ensemble import NetworkEnsemble, NetworkSettings
from graspcast.forecasting.models.visibility import Visibility
from graspcast.forecasting.novelty import OOD_ALPHA, Novelty
from graspcast.forecasting.one_estimator import (
    ALONE,
    check_learned,
    fit_alone,
    learns_alone,
    visibility_settings,
    with_alone,
)
from graspcast.forecasting.pose_checks import refuse_most
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.training_scope import FOREST_METHODS, LEAST, Scope, scope_of
from graspcast.forecasting.visibility_features import features_of_one, median_row
from graspcast.io.arguments import NAME, a, checked, mapping
from graspcast.io.progress import Progress, step_of
from graspcast.io.provenance import versions
from graspcast.simulation.grasps.table import GraspTable, read_grasps

__all__ = ["fit_forecaster", "train_forecaster"]

_FEW = 50
"""Outcomes below which a warning is given."""
_METHODS = tuple(name for name in KINDS if name != ALONE)


@checked(
    training_data=a(TrainingData),
    method=NAME,
    models=mapping(a(Models), "dataset"),
    grasps=a(GraspTable),
)
def train_forecaster(
    training_data: TrainingData,
    *,
    method: str = "blend",
    features: FeatureSet = "paper",
    settings: NetworkSettings | None = None,
    forests: ForestSettings | None = None,
    models: Mapping[str, Models] | None = None,
    guides: Sequence[str] | None = None,
    learn_from: Sequence[str] = (),
    grasps: GraspTable | None = None,
    progress: Progress | None = None,
) -> Forecaster:
    """Train a forecaster for a principal, its supporters, a gripper and objects.

    The order of the estimators makes no difference: they are sorted by name.
    :meth:`Forecaster.guided_by` returns the forecaster for another principal, where its grasps have
    outcomes too. With poses fused from several views in the training data, it also forecasts with
    views (:meth:`Forecaster.judge`).

    One estimator is enough. From one view it is then forecast by its pose, its score and, where
    :attr:`Estimates.seen` has it, image fit (:mod:`graspcast.forecasting.models.visibility`): the
    methods ``blend`` and ``direct`` do so, from outcomes. That is much weaker than a consensus.

    Parameters
    ----------
    training_data
        Instances with outcomes; ground truth, outcomes of grasps that other estimators guided, and
        simulated trials are used by the methods made of forests.
    method
        ``blend`` (the default), its parts ``two-stage`` and ``direct``; ``threshold`` (on ADD),
        ``MLP`` (the paper's networks, one ensemble for each object) or ``MLP-O`` (one for all
        objects). ``two-stage`` needs ground truth; without any, ``blend`` equals ``direct``.
    features
        Of networks, ``paper`` or ``rich``; the other methods have their own.
    settings
        Of networks.
    forests
        Of ``blend``, ``two-stage`` and ``direct``.
    models
        Dataset's name to its object models, for all but the paper's features.
    guides
        The estimators that may guide besides the principal, for the methods made of forests; by
        default all with ten or more outcomes, successes and failures among them.
    learn_from
        Estimators of the training data that are learned from, but not needed at run time
        (:meth:`TrainingData.learning_from`): success given error, of ``blend`` and ``two-stage``,
        is the same whichever estimator made the error, so the outcomes of grasps that these guided
        teach it too. They are no supporters and no guides. With a single estimator left it serves
        forecasts with several views.
    grasps
        The grasps that the outcomes are of, which the model file carries for the robot; by default
        the built-in ones (:func:`graspcast.read_grasps`).
    progress
        Called with the share of the work that is done and a message.

    Raises
    ------
    UnknownNameError
        For an unknown method.
    InputError
        For fewer than ten tried instances, or only successes or only failures, unless there are
        simulated trials; for a method or simulated trials that need ground truth without any; for
        estimators to learn from without outcomes or ground truth, or where they teach nothing.

    Warns
    -----
    TrainingDataWarning
        For few instances, or a single scene; the model card keeps the text.
    """
    training_data = training_data.learning_from(*learn_from)
    if training_data.learned is not None:
        training_data.learned.check(training_data.truth, training_data.gripper)
    forecaster = fit_forecaster(
        training_data,
        method=method,
        features=features,
        settings=settings,
        forests=forests,
        models=models,
        guides=guides,
        progress=progress,
    )
    for text in forecaster.card.warnings:
        warnings.warn(text, TrainingDataWarning, stacklevel=3)  # beyond the wrapper of checked
    return forecaster.with_objects(models or {}, read_grasps() if grasps is None else grasps)


def fit_forecaster(
    training_data: TrainingData,
    *,
    method: str = "blend",
    features: FeatureSet = "paper",
    settings: NetworkSettings | None = None,
    forests: ForestSettings | None = None,
    models: Mapping[str, Models] | None = None,
    guides: Sequence[str] | None = None,
    learn_from: Sequence[str] = (),
    progress: Progress | None = None,
) -> Forecaster:
    """Train a forecaster as :func:`train_forecaster` does, without Python warnings.

    For cross-validation and for programs that show the model card's warnings themselves.
    """
    if method not in _METHODS:
        raise UnknownNameError("method", method, _METHODS, parameters=("method",))
    training_data = training_data.learning_from(*learn_from)
    if (learned := training_data.learned) is not None:
        alone, views = len(training_data.estimates.estimators) == 1, training_data.views is not None
        whose = learned.estimators, training_data.principal
        check_learned(*whose, method, alone=alone, views=views)
    in_order = sorted(training_data.estimates.estimators)  # whatever the order they are given in
    scope = scope_of(training_data.only(*in_order), method)
    data = scope.data
    used: Any = None
    feature_set: str = features
    if method == "threshold":
        feature_set = "add"
    elif method in FOREST_METHODS:
        feature_set, used = "full", forests or ForestSettings()
        if (weight := FOREST_METHODS[method]) is not None:
            used = replace(used, direct=weight)
    else:
        pools, scales = method == "MLP-O", features == "rich"
        used = replace(settings or NetworkSettings(), pools_objects=pools, standardise=scales)
    refuse_most(data.estimates, models)
    if data.learned is not None:
        data.learned.refuse_most(data.estimates, models)
    if learns_alone(data) and data.views is None:
        return _fit_alone(scope, used, models or {}, progress)
    if method in FOREST_METHODS:
        return _fit_forests(scope, method, used, models or {}, guides, progress)
    card = _card(scope, method, feature_set, used, models or {})
    values = features_of(data.estimates, card.principal, card.features, models).values
    success, numbers = data.own_success == 1, np.searchsorted(card.objects, data.objects)
    predictor: Predictor
    if method == "threshold":
        predictor = Thresholds.fit(values, success, numbers)
    else:
        predictor = NetworkEnsemble.fit(values, success, numbers, used, progress=progress)
    return _assembled(data, card, predictor, values)


def _fit_alone(
    scope: Scope,
    settings: ForestSettings,
    models: Mapping[str, Models],
    progress: Progress | None,
) -> Forecaster:
    """Fit the forecaster of one estimator's single view."""
    fitted = fit_alone(scope.data, scope.targets, settings, progress=progress)
    card = _card(scope, ALONE, ONE_VIEW_FEATURES, visibility_settings(settings), models)
    return _assembled(scope.data, card, fitted, features_of_one(scope.data.estimates).values)


def _fit_forests(
    scope: Scope,
    method: str,
    settings: ForestSettings,
    models: Mapping[str, Models],
    guides: Sequence[str] | None,
    progress: Progress | None,
) -> Forecaster:
    """Fit the methods made of forests, for every guide."""
    data = scope.data
    names = _guides(data, guides)
    alone = method != "two-stage" and learns_alone(data)
    share = step_of(progress, 0, 2) if alone else progress
    blends = grow_blends(data, names, scope.targets, models, settings, progress=share)
    each = []
    for name in names:
        mine, blend = replace(scope, data=replace(data, principal=name)), blends[name]
        card = _card(mine, method, ONE_VIEW_FEATURES if alone else "full", settings, models)
        values = np.zeros((len(data), 0))
        if card.supporters:
            values = features_of(data.estimates, name, "full", models).values
        elif alone:
            share = step_of(progress, 1, 2)
            blend = with_alone(blend, fit_alone(data, scope.targets, settings, progress=share))
            values = features_of_one(data.estimates).values
        each.append(_assembled(mine.data, card, blend, values))
    return replace(each[0], others=tuple(each[1:]))


def _guides(data: TrainingData, wanted: Sequence[str] | None) -> list[str]:
    """Return the estimators that may guide, the principal first."""
    if wanted is not None:
        for name in wanted:
            data.estimates.index(name)
    out = [data.principal]
    each = data.every_success.swapaxes(0, 1)
    for name, success in zip(data.estimates.estimators, each, strict=True):
        tried, held = int((~np.isnan(success)).sum()), int((success == 1).sum())
        enough = tried >= LEAST and 0 < held < tried
        if name not in out and (enough if wanted is None else name in wanted):
            out.append(name)
    return out


def _assembled(
    data: TrainingData, card: ModelCard, predictor: Predictor, values: Float[ndarray, "n d"]
) -> Forecaster:
    """Add novelty and the card's warnings to a model."""
    novelty, typical = None, np.zeros(0)
    if card.supporters or card.features == ONE_VIEW_FEATURES:
        diameter_m = card.diameters_of(data.objects)
        novelty = Novelty.fit(data.estimates, card.principal, diameter_m)
        card = replace(card, smallest_p_value=novelty.smallest_p_value)
        typical = np.median(values, axis=0) if card.supporters else median_row(values)
    warned = (*_limitations(data, novelty, predictor), *rarely_tried(card.grasps))
    card = replace(card, warnings=warned)
    return Forecaster(card, predictor, novelty, typical)


def _limitations(
    data: TrainingData, novelty: Novelty | None, predictor: Predictor
) -> tuple[str, ...]:
    """Say what the training data are too few for."""
    out = []
    outcomes, count = int((~np.isnan(data.own_outcomes)).sum()), len(data)
    scenes = len(set(unit_names(data.estimates.instances, "scene").tolist()))
    if 0 < outcomes < _FEW:
        out.append(
            f"trained on {outcomes} outcomes: probabilities are rough guesses; give {_FEW} or more"
        )
    if scenes == 1:
        out.append("trained on one scene: nothing is known about forecasts in other scenes")
    elif outcomes and _lacks_calibration(predictor):
        out.append(
            "probabilities are not calibrated: that takes outcomes in two scenes or more, with "
            "successes and failures in each part"
        )
    if (alone := visibility_of(predictor)) is not None:
        out.append(
            f"one estimator: from one view forecasts rest on the object and {alone.most}, mostly "
            "visibility, and are much weaker than those of a consensus or of several views"
        )
    elif novelty is not None and novelty.smallest_p_value > OOD_ALPHA:
        out.append(
            f"{count} instances give a smallest novelty p-value of {novelty.smallest_p_value:.3f}, "
            f"and the default level is {OOD_ALPHA:g}: only a disagreement larger than in training "
            f"is found out of distribution; train on {round(1 / OOD_ALPHA) - 1} or more"
        )
    return tuple(out)


def _lacks_calibration(predictor: Predictor) -> bool:
    """Whether forests could not be calibrated by out-of-fold predictions."""
    if isinstance(predictor, Visibility):
        return predictor.out_of_fold is None
    return isinstance(predictor, Blend) and not predictor.is_calibrated


def _diameters(objects: tuple[str, ...], models: Mapping[str, Models]) -> dict[str, float]:
    """Return the diameters of the objects whose models are known, metres."""
    names = [split_object_name(name) for name in objects]
    sizes = diameters([name for name, _ in names], [number for _, number in names], models)
    return {name: m for name, m in zip(objects, sizes.tolist(), strict=True) if np.isfinite(m)}


def _card(
    scope: Scope, method: str, features: str, settings: Any, models: Mapping[str, Models]
) -> ModelCard:
    data = scope.data
    own = data.own_outcomes
    own = own[~np.isnan(own)]
    seen = () if data.views is None else (data.views.statistics, data.views.cam_T_fused)
    if features == ONE_VIEW_FEATURES:
        seen = (*seen, *data.estimates.seen.values())
    named = ((np.array(name), held) for name, held in data.others.items())
    seen = (*seen, *(part for pair in named for part in pair))
    if (learned := data.learned) is not None:
        errors = () if learned.obj_T_est is None else (learned.obj_T_est,)
        seen = (*seen, learned.cam_T_obj, learned.success, *errors)
    return ModelCard(
        principal=data.principal,
        supporters=data.estimates.supporters(data.principal),
        gripper=data.gripper,
        objects=scope.targets.objects,
        method=method,
        features=features,
        settings={} if settings is None else asdict(settings),
        samples=len(own),
        success_rate=float(own.sum()) / max(1, len(own)),
        data=digest_of(data.estimates, data.success, data.truth, *seen),
        versions=versions(),
        simulated=scope.simulated,
        scenes=tuple(sorted(set(unit_names(data.estimates.instances, "scene").tolist()))),
        diameters_m=_diameters(scope.targets.objects, models),
        views={} if data.views is None else dict(data.views.rules),
        learned_from={} if learned is None else learned.counts(data.truth),
        grasps=grasp_counts(data, scope.targets) if scope.targets.has_several else {},
    )
