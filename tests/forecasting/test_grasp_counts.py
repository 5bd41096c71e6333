"""On how many outcomes each grasp rests."""

from __future__ import annotations

import dataclasses

import numpy as np

import synthetic
from graspcast.forecasting.grasp_counts import grasp_counts, rarely_tried
from graspcast.forecasting.models.targets import Targets


def test_outcomes_of_all_guides_count_and_else_simulated_trials() -> None:
    data = synthetic.several_grasps(60, 1)
    data.others["g1"][:, data.objects == "d-2"] = np.nan
    data.others["g1"][1] = np.nan
    trials = synthetic.error_outcomes(7, "d-2")
    named = dataclasses.replace(trials, grasps=np.array(["g1"] * 3 + ["reference"] * 4))
    data = dataclasses.replace(data, simulated=named)
    targets = Targets.of([(o, g) for o in ("d-1", "d-2") for g in ("reference", "g1")])
    assert grasp_counts(data, targets) == {
        "d-1": {"g1": 60, "reference": 90},
        "d-2": {"g1": 3, "reference": 90},
    }


def test_grasps_with_few_outcomes_are_named() -> None:
    assert rarely_tried({"d-1": {"top": 10}, "d-2": {"reference": 40}}) == ()
    (said,) = rarely_tried({"d-1": {"top": 9, "side": 30}, "d-2": {"rim": 0}})
    assert said.endswith("come after all others: top of d-1 (9), rim of d-2 (0)")
    (said,) = rarely_tried({"d-1": {f"g{i}": i for i in range(8)}})
    assert said.endswith("g4 of d-1 (4) and 3 more")
