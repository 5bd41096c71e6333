"""Training a forecaster, and scoring its method on what training has not seen."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from graspcast._version import __version__
from graspcast.bop.models import Models
from graspcast.errors import InputError, UnknownNameError
from graspcast.estimates.instances import unit_names
from graspcast.forecasting.features import FeatureSet, features_of
from graspcast.forecasting.forecaster import KINDS, Forecaster
from graspcast.forecasting.model_card import ModelCard, digest_of
from graspcast.forecasting.models.add_threshold import Thresholds
from graspcast.forecasting.models.blend import Blend, ForestSettings
from graspcast.forecasting.models.mlp.ensemble import NetworkEnsemble, NetworkSettings
from graspcast.forecasting.novelty import Novelty
from graspcast.forecasting.samples import Samples
from graspcast.forecasting.training_data import TrainingData, as_training_data

__all__ = ["train_forecaster"]

_FORESTS = {"blend": None, "two-stage": 0.0, "direct": 1.0}


def train_forecaster(
    given: Samples | TrainingData,
    *,
    method: str = "blend",
    features: FeatureSet = "paper",
    settings: NetworkSettings | None = None,
    forests: ForestSettings | None = None,
    models: Mapping[str, Models] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Forecaster:
    """Train a forecaster for a principal, its supporters, a gripper and objects.

    Parameters
    ----------
    given
        Instances with outcomes; lessons may add ground truth, outcomes of grasps that the other
        estimators guided, and simulated trials.
    method
        ``blend`` (the default), its parts ``two-stage`` (needs ground truth) and ``direct``;
        ``threshold`` (on ADD), ``MLP`` (the paper's networks for each object) or ``MLP-O`` (for
        all), which learn from the principal's outcomes alone.
    features
        Of networks, ``paper`` or ``rich``; the other methods have their own.
    settings
        Of networks.
    forests
        Of ``blend``, ``two-stage`` and ``direct``.
    models
        Dataset's name to its object models, for all but the paper's features.
    progress
        Called with the share of the work that is done.

    Raises
    ------
    UnknownNameError
        For an unknown method.
    InputError
        For fewer than ten samples, or only successes or only failures, unless there are simulated
        trials.
    """
    if method not in KINDS:
        raise UnknownNameError("method", method, KINDS)
    learned = as_training_data(given)
    if not learned.has_truth.any() and (method == "two-stage" or learned.simulated is not None):
        raise InputError(
            "two stages, and so simulated trials, need ground truth of some images: give the "
            "datasets' --bop with scene_gt.json, or --ground-truth; or leave out the simulated "
            "trials"
        )
    answered = ~np.isnan(learned.success).all(axis=0)
    if method == "two-stage":
        answered &= learned.has_truth
    with_outcomes = set(learned.estimates.objects[answered].tolist())
    in_forests = method in _FORESTS
    simulated = set()
    if in_forests and learned.simulated is not None:
        simulated = set(learned.simulated.objects.tolist())
    own = learned.success[learned.estimates.index(learned.principal)]
    tried = ~np.isnan(own)
    held = int((own[tried] == 1).sum())
    if not simulated and (tried.sum() < 10 or held in (0, tried.sum())):
        raise InputError(
            f"{tried.sum()} samples with {held} successes are too few to learn from: give at "
            "least ten, with both outcomes"
        )
    used: Any = forests or ForestSettings()
    if in_forests:
        share = _FORESTS[method]
        used = used if share is None else replace(used, direct=share)
        features = "full"
        scope, names = learned, tuple(sorted(with_outcomes | simulated))
    else:
        used = replace(
            settings or NetworkSettings(),
            pools_objects=method == "MLP-O",
            standardise=features == "rich",
        )
        scope = learned.select(tried)
        names = tuple(sorted(set(scope.estimates.objects.tolist())))
    estimates = scope.estimates
    card = ModelCard(
        principal=learned.principal,
        supporters=estimates.supporters(learned.principal),
        gripper=learned.gripper,
        objects=names,
        method=method,
        features="add" if method == "threshold" else features,
        settings={} if method == "threshold" else asdict(used),
        samples=int(tried.sum()),
        success_rate=held / max(1, int(tried.sum())),
        data=digest_of(estimates, scope.success, scope.truth),
        versions={
            "graspcast": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
        simulated=tuple(sorted(simulated - with_outcomes)) if in_forests else (),
        scenes=tuple(sorted(set(unit_names(estimates.instances, "scene").tolist()))),
    )
    values = features_of(estimates, card.principal, card.features, models).values
    predictor: Blend | Thresholds | NetworkEnsemble
    if in_forests:
        predictor = Blend.fit(scope, names, models or {}, used, progress=progress)
    else:
        success = own[tried] == 1
        numbers = np.searchsorted(names, estimates.objects)
        if method == "threshold":
            predictor = Thresholds.fit(values, success, numbers)
        else:
            predictor = NetworkEnsemble.fit(values, success, numbers, used, progress=progress)
    return Forecaster(
        card,
        predictor,
        Novelty.fit(estimates, card.principal),
        np.median(values, axis=0),
    )
