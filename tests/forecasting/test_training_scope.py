"""What of the training data a method learns."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import synthetic
from graspcast.errors import InputError
from graspcast.forecasting.training_scope import scope_of


def test_grasps_are_learned_from_outcomes_and_from_simulated_trials() -> None:
    data = synthetic.several_grasps(60, 1)
    data.others["g1"][:, data.objects == "d-2"] = np.nan
    trials = synthetic.error_outcomes(20, "d-3")
    named = dataclasses.replace(trials, grasps=np.array(["top"] * 20))
    scope = scope_of(dataclasses.replace(data, simulated=named), "blend")
    assert scope.targets.objects == ("d-1", "d-2", "d-3")
    assert scope.targets.grasps == (("g1", "reference"), ("reference",), ("top",))
    assert scope.simulated == ("d-3",)


@pytest.mark.parametrize("method", ["threshold", "MLP", "MLP-O"])
def test_a_method_that_knows_one_grasp_refuses_several(method: str) -> None:
    with pytest.raises(InputError, match=f"{method} forecasts the reference grasp.*reference, g1"):
        scope_of(synthetic.several_grasps(60, 1), method)
    assert not scope_of(synthetic.training_data(60), method).targets.has_several


def test_a_network_does_not_learn_from_simulated_trials_alone() -> None:
    data = synthetic.training_data(60)
    nothing = np.full_like(data.own_outcomes, np.nan)
    only = dataclasses.replace(data, success=nothing, simulated=synthetic.error_outcomes(20, "d-3"))
    with pytest.raises(InputError, match="the method MLP does not learn from simulated trials"):
        scope_of(only, "MLP")


def test_too_few_outcomes_are_counted_over_all_grasps() -> None:
    data = synthetic.several_grasps(6, 1)
    scope_of(data, "blend")
    with pytest.raises(InputError, match="6 outcomes of a"):
        scope_of(data.of_grasp(), "blend")
