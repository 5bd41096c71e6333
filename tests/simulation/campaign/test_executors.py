from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspcast.errors
from campaign_script import make_requests
from graspcast.errors import ExtraMissingError, InputError
from graspcast.simulation.campaign.campaign import run_campaign
from graspcast.simulation.campaign.executors import LocalExecutor, usable_cores
from graspcast.simulation.campaign.jobs import Batch, load_setups
from graspcast.simulation.campaign.ray_executor import RayExecutor
from graspcast.simulation.grasps.table import read_grasps

SOURCE = Path(graspcast.errors.__file__).parents[1]


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    ray = pytest.importorskip("ray", reason="needs Ray: pip install 'graspcast[ray]'")
    from ray.cluster_utils import Cluster

    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    made.add_node(num_cpus=1)
    ray.init(
        address=made.address,
        runtime_env={"env_vars": {"PYTHONPATH": str(SOURCE)}},
        log_to_driver=False,
    )
    yield made
    ray.shutdown()
    made.shutdown()


# Ray itself leaves sockets and processes to the garbage collector.
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore::FutureWarning")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_node_killed_in_mid_run_loses_nothing(cluster: Any, tmp_path: Path) -> None:
    requests = make_requests(192)
    setups = load_setups(requests, read_grasps())
    alive: list[int] = []

    def watch(share: float, message: str) -> None:
        import ray

        if share >= 32 / 192 and not alive:
            alive.append(len(cluster.list_all_nodes()))
            second = next(iter(cluster.worker_nodes))
            # A kill, not a farewell: the trials that it was at are lost with it.
            cluster.remove_node(second, allow_graceful=False)
            end = time.monotonic() + 60
            while sum(node["Alive"] for node in ray.nodes()) > 1 and time.monotonic() < end:
                time.sleep(0.1)
            alive.append(sum(node["Alive"] for node in ray.nodes()))

    outcomes = run_campaign(
        requests, setups, tmp_path / "ray", executor=RayExecutor(), progress=watch
    )
    assert alive == [2, 1]
    local = run_campaign(requests, setups, tmp_path / "local", executor=LocalExecutor(1))
    assert outcomes.drop("computed_s").equals(local.drop("computed_s"))


def test_without_ray_the_message_has_the_pip_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    with pytest.raises(ExtraMissingError, match=r"pip install 'graspcast\[ray\]'"):
        RayExecutor()


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
