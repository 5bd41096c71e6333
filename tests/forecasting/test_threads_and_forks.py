"""Verdicts from many threads at once, and after a fork, in processes of their own.

Each process computes what one thread computes, and compares it with what it then gets.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import synthetic
from graspcast.bop.models import Models
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings
from graspcast.forecasting.train import train_forecaster
from poses import write_models

SETTINGS = {
    "forests": ForestSettings(trees=16, draws=64, folds=2),
    "settings": NetworkSettings(members=2, optimiser=MlpSettings(epochs=5)),
}
slow = pytest.mark.slow
WAYS = ("blend", pytest.param("MLP-O", marks=slow))

COMMON = """
import multiprocessing, os, sys, threading, time, traceback
from concurrent.futures import ThreadPoolExecutor
import numba
import numpy as np
import synthetic
from graspcast import Forecaster
from graspcast.bop.models import Models

forecaster = Forecaster.load(sys.argv[1])
models = {"d": Models(sys.argv[2])}
many = synthetic.estimates(600, seed=3)

def one(i):
    poses = dict(zip(many.estimators, many.cam_T_obj[:, i], strict=True))
    verdict = forecaster.predict(poses, str(many.objects[i]), models=models, explain=True)
    return verdict.probability, verdict.p_value, verdict.attribution

def batch():
    found = [(v.probability, v.p_value) for v in forecaster.verdicts(many, models)]
    return np.array(found)

def in_children(check, how_many=8, leave=os._exit):
    children = []
    for k in range(how_many):
        child = os.fork()
        if child == 0:
            code = 1
            try:
                check(k)
                code = 0
            except BaseException:
                traceback.print_exc()
            leave(code)
        children.append(child)
    deadline, codes = time.monotonic() + 60, []
    for child in children:
        while (ended := os.waitpid(child, os.WNOHANG))[0] == 0:
            if time.monotonic() > deadline:
                os.kill(child, 9)
            time.sleep(0.002)
        codes.append(os.waitstatus_to_exitcode(ended[1]))
    assert codes == [0] * how_many, codes
"""

THREADS = """
def asked(thread):
    if thread == 0:
        return batch()
    return [one(i) for i in range(20)]

with ThreadPoolExecutor(8) as pool:  # nothing is compiled or read yet
    first, *others = pool.map(asked, range(8))
single, whole = [one(i) for i in range(20)], batch()
assert all(other == single for other in others)
assert np.array_equal(first, whole)
with ThreadPoolExecutor(8) as pool:
    assert all(np.array_equal(found, whole) for found in pool.map(lambda _: batch(), range(8)))
try:  # numba's layers, of which some survive neither threads nor forks, have no part in it
    raise AssertionError(numba.threading_layer())
except ValueError:
    pass
"""

FORK = """
single, whole = [one(i) for i in range(5)], batch()

def check(k):
    assert [one(i) for i in range(5)] == single
    assert k % 3 or np.array_equal(batch(), whole)

in_children(check)
in_children(check, 2, leave=sys.exit)  # that ends as a process of its own does
"""

PROCESSES = """
if __name__ == "__main__":
    single = [one(i) for i in range(8)]
    batch()
    for way in sys.argv[3:]:
        with multiprocessing.get_context(way).Pool(2) as pool:
            assert pool.map_async(one, range(8)).get(timeout=60) == single
"""


@pytest.fixture(scope="module", params=WAYS)
def folder(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    folder = tmp_path_factory.mktemp("threads")
    models = {"d": Models(write_models(folder / "models", obj_1={}, obj_2={}))}
    data = synthetic.training_data()
    train_forecaster(data, method=request.param, features="rich", models=models, **SETTINGS).save(
        folder / "model.npz"
    )
    return folder


def run(folder: Path, script: str, *arguments: str) -> None:
    """Run a script, which raises if a verdict differs; batches are on four threads."""
    file = folder / "script.py"
    file.write_text(COMMON + script)
    paths = [str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths), "NUMBA_NUM_THREADS": "4"}
    command = [sys.executable, file, folder / "model.npz", folder / "models", *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.slow
def test_eight_threads_at_once_and_children_get_what_one_gets(folder: Path) -> None:
    run(folder, THREADS + (FORK if hasattr(os, "fork") else ""))


@pytest.mark.slow
def test_pools_of_processes(folder: Path) -> None:
    run(folder, PROCESSES, *(["fork"] if hasattr(os, "fork") else []), "spawn")
