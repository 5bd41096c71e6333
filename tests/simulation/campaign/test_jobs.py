from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from graspcast.errors import (
    CampaignStoppedError,
    UnknownNameError,
)
from graspcast.simulation.campaign.campaign import run_campaign
from graspcast.simulation.campaign.executors import LocalExecutor
from graspcast.simulation.campaign.jobs import TrialSetup, load_setups
from graspcast.simulation.campaign.requests import SetupKey, TrialRequests
from graspcast.simulation.grasps.table import read_grasps

ONE = LocalExecutor(1)


def _changed(requests: TrialRequests, **columns: Any) -> pl.DataFrame:
    return requests.keys.drop("object").with_columns(**columns)


def test_an_object_without_a_grasp(requests: TrialRequests) -> None:
    keys = _changed(requests, obj_id=pl.lit(10), dataset=pl.lit("lmo"))
    with pytest.raises(UnknownNameError, match="grasp of 'lmo-10' by 'parallel'"):
        load_setups(TrialRequests(keys, requests.obj_T_est), read_grasps())


def test_a_trial_that_fails_stops_with_its_cause(
    requests: TrialRequests, setups: dict[SetupKey, TrialSetup], tmp_path: Path
) -> None:
    setup = setups["ycbv-4", "parallel", "reference"]
    other = replace(setup.grasp, object="ycbv-9")
    wrong = TrialSetup(setup.grasp_object, setup.gripper, other, setup.settings)
    with pytest.raises(
        CampaignStoppedError,
        match=r"a trial of ycbv-4 by parallel, grasp reference failed: Mism.*0 of 40",
    ):
        run_campaign(
            requests, {("ycbv-4", "parallel", "reference"): wrong}, tmp_path / "o", executor=ONE
        )
