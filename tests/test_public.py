"""The public API: everything in it exists, and importing it is cheap."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import graspcast
import synthetic
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings

ENV = {**os.environ, "PYTHONPATH": str(Path(graspcast.__file__).parents[1])}


def test_everything_public_is_there_and_documented() -> None:
    for name in graspcast.__all__:
        value = getattr(graspcast, name)
        if name != "__version__":
            assert inspect.getdoc(value), name
    assert dir(graspcast) == sorted(graspcast.__all__)


def test_names_for_type_checkers_are_those_at_run_time() -> None:
    source = inspect.getsource(graspcast)
    block = source[source.index("if TYPE_CHECKING:") : source.index("_HOME")]
    named = set()
    for line in block.replace("(", " ").replace(")", " ").splitlines()[1:]:
        named |= set(line.rpartition("import ")[2].replace(",", " ").split())
    assert named == set(graspcast.__all__) - {"__version__"}


def test_unknown_names_are_refused() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        graspcast.nothing  # noqa: B018


def test_importing_loads_nothing_heavy() -> None:
    heavy = ["numpy", "scipy", "sklearn", "polars", "numba", "mujoco", "trimesh", "rich"]
    code = f"import sys, graspcast, graspcast.cli; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=ENV
    )
    assert done.stdout.strip() == "[]"


def test_representations_are_short() -> None:
    data = synthetic.tried(60)
    settings = NetworkSettings(members=1, optimiser=MlpSettings(epochs=2))
    forecaster = graspcast.train_forecaster(data, method="MLP-O", settings=settings)
    assert repr(data) == (
        "TrainingData(60 instances, 60 with outcomes, 0 with true poses; principal a, "
        "parallel gripper)"
    )
    assert repr(data.estimates) == "Estimates(a, b, c; Instances(60 of 2 objects in 60 images))"
    assert repr(forecaster) == (
        "Forecaster(MLP-O: a with b, c; parallel gripper, 2 objects, 60 samples)"
    )
    assert repr(synthetic.error_outcomes(5, "d-1")) == "SimulatedTrials(5 of 1 objects)"
    certificate = graspcast.certify_forecaster(forecaster, data, allow_training_scenes=True)
    assert repr(certificate).startswith("Certificate(all objects: ")
    key = graspcast.InstanceKey("d", 1, 2, 3, 0)
    row = graspcast.VerdictRow(key, "a", "hand", graspcast.Verdict(True, 0.9, "why"), np.eye(4))
    assert repr(row) == "VerdictRow(d-3 in image 1/2, est_id 0 by a, hand gripper: attempt)"
