"""A dataset whose images become scenes, and a trial that was recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cubes import write_tables
from graspcast.bop.dataset import BopDataset
from graspcast.pose.transforms import transform
from graspcast.simulation.grasps.table import GraspTable, ReferenceGrasp, read_grasps
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.catalogue import read_catalogue
from graspcast.simulation.objects.load import load_object
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.recording import Recording, record_trial
from graspcast.simulation.trial.trial import TrialRunner
from overlays import write_estimates


@pytest.fixture(scope="session")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset called made, and estimates of it by a and b."""
    return write_estimates(tmp_path_factory.mktemp("seen"))


@pytest.fixture
def dataset(seen: Path) -> BopDataset:
    return BopDataset(seen / "made")


@pytest.fixture(scope="session")
def table() -> GraspTable:
    """Two grasps of made-1 from above: the reference, and one 10 mm higher."""
    down = np.diag([1.0, -1.0, -1.0])
    grasps = [
        Grasp(transform(down, np.array([0.0, 0.0, z])), "made-1", "parallel", name)
        for name, z in (("reference", 0.015), ("higher", 0.025))
    ]
    return GraspTable([ReferenceGrasp(grasp, "by a test") for grasp in grasps])


@pytest.fixture(scope="session")
def runner(tmp_path_factory: pytest.TempPathFactory) -> TrialRunner:
    folder = tmp_path_factory.mktemp("cube")
    write_tables(folder)
    reference = read_grasps(folder / "grasps.toml")("cube", "parallel")
    target = load_object("cube", catalogue=read_catalogue(folder / "objects.toml"))
    return TrialRunner(reference.applied_to(target), load_gripper("parallel"))


@pytest.fixture(scope="session")
def held(runner: TrialRunner) -> Recording:
    """The cube, held by a grasp that an estimate 10 mm off along the fingers guides."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.015
    off = transform(np.eye(3), np.array([0.0, 0.010, 0.0]))
    return record_trial(runner, off, Grasp(pose, "cube", "parallel"))
