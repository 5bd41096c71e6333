"""A cube, its trials and its pictures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from cubes import MISS, OFF, SIZE, write_tables
from graspcast.rendering.trials.renderer import SceneRenderer
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.recording import Recording, record_trial
from graspcast.simulation.trial.trial import TrialRunner
from solids import box, from_above


@pytest.fixture(scope="module")
def runner() -> TrialRunner:
    return TrialRunner(box(), load_gripper("parallel"))


@pytest.fixture(scope="module")
def grasp() -> Grasp:
    return Grasp(from_above(box(), 0.015), "box", "parallel")


@pytest.fixture(scope="module")
def held(runner: TrialRunner, grasp: Grasp) -> Recording:
    return record_trial(runner, OFF, grasp)


@pytest.fixture(scope="module")
def missed(runner: TrialRunner, grasp: Grasp) -> Recording:
    return record_trial(runner, MISS, grasp, early_stop=False)


@pytest.fixture(scope="module")
def renderer(runner: TrialRunner) -> Iterator[SceneRenderer]:
    with SceneRenderer(runner.grasp_object, runner.gripper, width=SIZE, height=SIZE) as drawing:
        yield drawing


@pytest.fixture
def tables(tmp_path: Path) -> list[str]:
    return write_tables(tmp_path)
