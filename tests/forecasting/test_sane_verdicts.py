"""Verdicts on sane instances: with supporters as ever, alone with what they rest on."""

from __future__ import annotations

import pytest

import graspcast
import one_estimator as world
import synthetic
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings
from graspcast.forecasting.sane_verdicts import decide_sane

HOW = {"threshold": 0.5, "guarantee": "held", "ood_alpha": 0.0, "explain": False}


def test_a_consensus_has_a_p_value_and_one_estimator_none() -> None:
    several, one = synthetic.tried(120), world.seen().data
    quick = ForestSettings(trees=8, folds=0)
    short = NetworkSettings(members=1, optimiser=MlpSettings(epochs=40))
    forecaster = graspcast.train_forecaster(several, method="MLP-O", settings=short)
    with pytest.warns(match="one estimator"):
        alone = graspcast.train_forecaster(one, forests=quick)
    for verdict in decide_sane(forecaster, several.estimates, None, **HOW):  # type: ignore[arg-type]
        assert verdict.p_value is not None
        assert verdict.guarantee == "held"
        assert "rests on" not in verdict.reason
    for verdict in decide_sane(alone, one.estimates, None, **HOW):  # type: ignore[arg-type]
        assert (verdict.p_value, verdict.out_of_distribution) == (None, None)
        assert verdict.guarantee == "held"
        assert verdict.reason.endswith("rests on the pose and its score, mostly visibility")
