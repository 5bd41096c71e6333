from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import graspcast.errors
from campaign_script import make_requests
from graspcast.errors import InputError
from graspcast.simulation.campaign.executors import LocalExecutor, usable_cores
from graspcast.simulation.campaign.jobs import Batch, load_setups
from graspcast.simulation.grasps.table import read_grasps

SOURCE = Path(graspcast.errors.__file__).parents[1]


def test_workers_must_be_some() -> None:
    with pytest.raises(InputError, match="workers is 0"):
        LocalExecutor(0)
    assert LocalExecutor().workers == usable_cores() >= 1


@pytest.mark.slow
def test_an_error_in_a_worker_is_raised_here() -> None:
    requests = make_requests(1)
    setups = load_setups(requests, read_grasps())
    pair = ("ycbv-4", "parallel", "reference")
    poses = np.eye(4)[None]
    batches = [Batch(("nobody", "parallel", "reference"), np.arange(1), poses)]
    with pytest.raises(KeyError, match="nobody"):
        list(LocalExecutor(2).run({pair: setups[pair]}, batches))


@pytest.mark.slow
@pytest.mark.skipif(not Path("/bin/false").exists(), reason="needs /bin/false: run it on Linux")
def test_a_worker_that_dies_at_once_is_noticed_however_long_the_command_line() -> None:
    program = """
import multiprocessing.spawn
import sys
from graspcast.errors import WorkerLostError
from graspcast.simulation.campaign.executors import LocalExecutor
from graspcast.simulation.campaign.jobs import Batch
multiprocessing.spawn.set_executable("/bin/false")
arguments = list(sys.argv)
try:
    list(LocalExecutor(2).run({}, [Batch(("a", "b", "c"), None, None)] * 2))
except WorkerLostError as error:
    print(error)
assert sys.argv == arguments and len(arguments) == 30_001
"""
    done = subprocess.run(
        [sys.executable, "-c", program, *["12345"] * 30_000],
        env={**os.environ, "PYTHONPATH": str(SOURCE)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert "a worker process died: it ended with exit code 1" in done.stdout, done.stderr
