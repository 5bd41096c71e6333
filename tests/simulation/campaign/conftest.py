"""A small campaign of real trials."""

from __future__ import annotations

from pathlib import Path

import pytest

from campaign_script import make_requests
from graspcast.simulation.campaign.campaign import run_campaign
from graspcast.simulation.campaign.executors import LocalExecutor
from graspcast.simulation.campaign.jobs import TrialSetup, load_setups
from graspcast.simulation.campaign.requests import SetupKey, TrialRequests
from graspcast.simulation.grasps.table import read_grasps

ONE = LocalExecutor(1)


@pytest.fixture(scope="module")
def requests() -> TrialRequests:
    return make_requests(40)


@pytest.fixture(scope="module")
def setups(requests: TrialRequests) -> dict[SetupKey, TrialSetup]:
    return load_setups(requests, read_grasps())


@pytest.fixture(scope="module")
def complete(
    requests: TrialRequests,
    setups: dict[SetupKey, TrialSetup],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    directory = tmp_path_factory.mktemp("campaigns") / "complete"
    run_campaign(requests, setups, directory, executor=ONE, sources={"epos": "a test"})
    return directory
