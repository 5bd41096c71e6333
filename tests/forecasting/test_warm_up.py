"""What a warmed-up forecaster no longer does at the first verdict."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import synthetic
from graspcast.bop.models import Models
from graspcast.errors import MismatchError
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.train import train_forecaster
from poses import write_models

SMALL = ForestSettings(trees=4, draws=8, folds=2)

FIRST_VERDICT = """
import sys
import numpy as np
import numba.core.dispatcher
from graspcast import Forecaster
from graspcast.bop.models import Models

forecaster = Forecaster.load(sys.argv[1])
models = {"d": Models(sys.argv[2])}
forecaster.warm_up(models)
modules = set(sys.modules)
compiled = []
old = numba.core.dispatcher.Dispatcher.compile
numba.core.dispatcher.Dispatcher.compile = lambda *given: (compiled.append(given), old(*given))[1]
import builtins, io, pathlib
def refused(*given, **options):
    raise AssertionError(f"a verdict opens {given}")
pathlib.Path.open = builtins.open = io.open = refused
pose = np.eye(4)
pose[2, 3] = 0.8
forecaster.predict({n: pose + 0 for n in "abc"}, "d-2", models=models)
assert not compiled, compiled
assert set(sys.modules) == modules, set(sys.modules) - modules
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("warm")
    models = {"d": Models(write_models(folder / "models", obj_1={}, obj_2={}))}
    train_forecaster(
        synthetic.training_data(), method="blend", features="full", forests=SMALL, models=models
    ).save(folder / "model.npz")
    return folder


@pytest.mark.slow
def test_the_first_verdict_compiles_imports_and_reads_nothing(folder: Path) -> None:
    command = [sys.executable, "-c", FIRST_VERDICT, folder / "model.npz", folder / "models"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


@pytest.mark.slow
def test_forecasts_do_not_depend_on_it(folder: Path) -> None:
    models = {"d": Models(folder / "models")}
    warm, cold = (Forecaster.load(folder / "model.npz") for _ in range(2))
    warm.warm_up(models)
    given = synthetic.estimates(30, seed=5)
    np.testing.assert_array_equal(warm.probability(given, models), cold.probability(given, models))


def test_models_that_are_needed_and_lacking_are_named(folder: Path) -> None:
    forecaster = Forecaster.load(folder / "model.npz")
    forecaster.warm_up()  # those that the file carries
    for models in ({}, {"other": Models(folder / "models")}):
        with pytest.raises(MismatchError, match="no object models for dataset 'd'"):
            forecaster.warm_up(models)


def test_objects_that_the_models_lack_are_left_out(folder: Path, tmp_path: Path) -> None:
    models = {"d": Models(write_models(tmp_path, obj_2={}))}
    Forecaster.load(folder / "model.npz").warm_up(models)
    assert list(models["d"].info) == [2]
