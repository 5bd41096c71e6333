from __future__ import annotations

import logging
import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import graspcast.errors
from campaign_script import make_requests
from graspcast.errors import (
    CampaignStoppedError,
    ExtraMissingError,
    InputError,
    MismatchError,
    WorkerLostError,
)
from graspcast.simulation.campaign.campaign import run_campaign
from graspcast.simulation.campaign.executors import LocalExecutor
from graspcast.simulation.campaign.jobs import TrialSetup, load_setups
from graspcast.simulation.campaign.ray_executor import RayExecutor
from graspcast.simulation.campaign.requests import SetupKey, TrialRequests
from graspcast.simulation.grasps.table import read_grasps

SOURCE = Path(graspcast.errors.__file__).parents[1]
MODULE = "graspcast.simulation.campaign.ray_executor"


class FakeRay:
    """What the executor uses of Ray; tasks run in this process when they are waited for."""

    def __init__(self, head: str) -> None:
        class TaskError(Exception):
            cause: Exception
            ip = "10.0.0.3"

        self.exceptions = SimpleNamespace(
            RayError=type("RayError", (Exception,), {}),
            RayTaskError=TaskError,
            WorkerCrashedError=type("WorkerCrashedError", (Exception,), {}),
            OutOfMemoryError=type("OutOfMemoryError", (Exception,), {}),
        )
        self.util = SimpleNamespace(
            get_node_ip_address=lambda: "10.0.0.3",
            scheduling_strategies=SimpleNamespace(
                NodeAffinitySchedulingStrategy=lambda node, soft: node
            ),
        )
        self.head, self.connected = head, False
        self.alive, self.cores = 2, 1
        self.put_count = self.most = 0
        self.results: dict[object, Callable[[], Any]] = {}
        self.crash: Exception | None = None

    def is_initialized(self) -> bool:
        return self.connected

    def init(self, **options: Any) -> None:
        if options["address"] == "mad":
            raise RuntimeError("Version mismatch: here\n    Python: 3.12.1")
        self.connected = True

    def shutdown(self) -> None:
        self.connected = False

    def get_runtime_context(self) -> Any:
        return SimpleNamespace(gcs_address=self.head)

    def nodes(self) -> list[dict[str, Any]]:
        return [
            {
                "Alive": number < self.alive,
                "Resources": {"CPU": float(self.cores)},
                "NodeID": number,
                "NodeManagerAddress": f"10.0.0.{number + 3}",
            }
            for number in range(2)
        ]

    def put(self, value: object) -> object:
        self.put_count += 1
        return value

    def remote(self, **_: Any) -> Callable[[Callable[..., Any]], Any]:
        def wrap(function: Callable[..., Any]) -> Any:
            def submit(*arguments: Any) -> object:
                reference = object()
                self.results[reference] = lambda: function(*arguments)
                self.most = max(self.most, len(self.results))
                return reference

            wrapped = SimpleNamespace(remote=submit)
            wrapped.options = lambda **_: wrapped
            return wrapped

        return wrap

    def wait(self, references: list[object], num_returns: int, timeout: float) -> Any:
        if not self.alive:
            time.sleep(0.01)
            return [], references
        return references[:num_returns], references[num_returns:]

    def get(self, reference: object) -> Any:
        if self.crash is not None:
            raise self.crash
        return self.results.pop(reference)()

    def cancel(self, reference: object, force: bool) -> None:
        self.results.pop(reference, None)


@pytest.fixture
def head() -> Iterator[str]:
    """An address at which something answers."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"127.0.0.1:{server.getsockname()[1]}"


@pytest.fixture
def ray(monkeypatch: pytest.MonkeyPatch, head: str) -> FakeRay:
    fake = FakeRay(head)
    monkeypatch.setitem(sys.modules, "ray", fake)
    monkeypatch.setattr(f"{MODULE}._LOOK_S", 0.0)
    return fake


@pytest.fixture(scope="module")
def trials() -> tuple[TrialRequests, dict[SetupKey, TrialSetup]]:
    requests = make_requests(80)
    return requests, load_setups(requests, read_grasps())


@pytest.mark.slow
def test_outcomes_are_those_of_this_process_and_few_batches_are_sent_at_a_time(
    ray: FakeRay, head: str, trials: Any, tmp_path: Path
) -> None:
    found = run_campaign(*trials, tmp_path / "ray", executor=RayExecutor(head, ahead=3))
    local = run_campaign(*trials, tmp_path / "local", executor=LocalExecutor(1))
    assert found.drop("computed_s").equals(local.drop("computed_s"))
    assert ray.most == 3  # of five
    assert ray.put_count == 1  # the setup, once for all batches
    assert not ray.connected and not ray.results


def test_an_address_at_which_nothing_answers_is_said_at_once(ray: FakeRay, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        nobody = f"127.0.0.1:{server.getsockname()[1]}"
    with pytest.raises(WorkerLostError, match=f"no Ray cluster answers at {nobody} .*refused") as e:
        next(RayExecutor(nobody).run({}, []))
    assert e.value.parameters == ("address",)
    with pytest.raises(
        WorkerLostError, match=r"could not be used: Version mismatch: here Python: 3.12.1$"
    ):
        next(RayExecutor("mad").run({}, []))


def test_what_the_cluster_found_by_itself_is_checked_too(
    ray: FakeRay, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("RAY_ADDRESS", "no-such-host.invalid:6379")
    with pytest.raises(WorkerLostError, match=r"answers at no-such-host.invalid:6379"):
        next(RayExecutor().run({}, []))
    monkeypatch.delenv("RAY_ADDRESS")
    monkeypatch.setenv("RAY_TMPDIR", str(tmp_path))
    (tmp_path / "ray").mkdir()
    (tmp_path / "ray" / "ray_current_cluster").write_text("127.0.0.1:1\n")
    with pytest.raises(WorkerLostError, match=r"answers at 127.0.0.1:1 "):
        next(RayExecutor().run({}, []))


def test_a_node_of_another_version_is_named_with_the_remedy(
    ray: FakeRay, head: str, trials: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mujoco.__version__", "3.9.9")
    said = r"the node 10.0.0.3 has mujoco 3.9.9 \(here .*the node 10.0.0.4 .*pip install 'grasp"
    with pytest.raises(CampaignStoppedError, match=said) as stopped:
        run_campaign(*trials, tmp_path, executor=RayExecutor(head))
    assert "0 of 80 trials are kept" in str(stopped.value)
    assert isinstance(stopped.value.__cause__, MismatchError)
    # A node that joins later is found by its first batch.
    monkeypatch.setattr(f"{MODULE}._Run.check_nodes", lambda run: None)
    with pytest.raises(CampaignStoppedError, match=r"the node 10.0.0.3 has mujoco 3.9.9"):
        run_campaign(*trials, tmp_path, executor=RayExecutor(head))


@pytest.mark.slow
def test_a_run_without_nodes_waits_and_says_so_until_one_is_back(
    ray: FakeRay,
    head: str,
    trials: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(f"{MODULE}._AGAIN_S", 0.02)
    ray.alive = 0
    nodes, looks = ray.nodes, iter(range(1000))

    def back_later() -> list[dict[str, Any]]:
        if next(looks) == 12:
            ray.alive = 1
        return nodes()

    monkeypatch.setattr(ray, "nodes", back_later)
    assert len(run_campaign(*trials, tmp_path, executor=RayExecutor(head))) == 80
    said = [record.getMessage() for record in caplog.records]
    waiting = [text for text in said if "no node of the Ray cluster runs trials" in text]
    assert 2 <= len(waiting) < 12
    assert "has 1 node again" in said[-1]


@pytest.mark.slow
def test_a_run_of_which_nothing_comes_back_says_so(
    ray: FakeRay,
    head: str,
    trials: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(f"{MODULE}._STILL_S", 0.05)
    wait, waits = ray.wait, iter(range(1000))

    def busy(references: list[object], num_returns: int, timeout: float) -> Any:
        if 1 <= next(waits) < 30:  # the first asks for versions
            time.sleep(0.01)
            return [], references
        return wait(references, num_returns, timeout)

    monkeypatch.setattr(ray, "wait", busy)
    run_campaign(*trials, tmp_path, executor=RayExecutor(head))
    said = [record.getMessage() for record in caplog.records]
    assert 1 <= len(said) <= 4
    assert all(
        "no trials have come back" in text and "2 nodes with 2 cores" in text for text in said
    )


def test_a_head_node_that_stays_silent_ends_the_run_with_a_message(
    ray: FakeRay, trials: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"{MODULE}._HEAD_S", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as server:
        ray.head = f"127.0.0.1:{server.getsockname()[1]}"
        batches = iter(range(100))

        def lose(share: float, message: str) -> None:
            if next(batches) == 2:
                ray.alive = 0
                server.close()

        with pytest.raises(CampaignStoppedError, match=r"head node .* was lost .*32 of 80 trials"):
            run_campaign(*trials, tmp_path, executor=RayExecutor(ray.head), progress=lose)
    assert not ray.connected


def test_trials_that_kill_workers_and_trials_that_fail_end_the_run(
    ray: FakeRay, head: str, trials: Any
) -> None:
    requests, setups = trials
    from graspcast.simulation.campaign.batches import Batches

    batches = Batches(requests, requests.rows_of("ycbv-4", "parallel", "reference"))
    crashes = {
        "21 workers died at the same trials of ycbv-4 by parallel: segfault": WorkerLostError,
        "no such file: hand.xml \\(on the node 10.0.0.3\\)": InputError,
        "the Ray cluster was lost: gone": WorkerLostError,
    }
    failed = ray.exceptions.RayTaskError("a traceback")
    failed.cause = InputError("no such file: hand.xml")
    errors = [ray.exceptions.WorkerCrashedError("segfault"), failed]
    errors.append(ray.exceptions.RayError("gone\nand more"))
    for (said, kind), error in zip(crashes.items(), errors, strict=True):
        run = RayExecutor(head).run(setups, batches)
        next(run)
        ray.crash = error
        with pytest.raises(kind, match=said):
            next(run)
        ray.crash = None
        assert not ray.connected


def test_a_connection_that_was_there_before_stays(ray: FakeRay, trials: Any) -> None:
    ray.connected = True
    assert list(RayExecutor().run(trials[1], [])) == []
    assert ray.connected


def test_without_ray_the_message_has_the_pip_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ExtraMissingError, match=r"pip install 'graspcast\[ray\]'"):
        RayExecutor()


class Nodes:
    """A real cluster whose head runs no trials, and nodes of one core."""

    def __init__(self, cluster: Any) -> None:
        self.cluster = cluster
        self.address = str(cluster.address)

    def add(self) -> Any:
        return self.cluster.add_node(num_cpus=1, wait=False)

    def kill(self, node: Any) -> None:
        # A kill, not a farewell: the trials that it was at are lost with it.
        self.cluster.remove_node(node, allow_graceful=False)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Nodes]:
    pytest.importorskip("ray", reason="needs Ray: pip install 'graspcast[ray]'")
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        patch.setenv("PYTHONPATH", str(SOURCE))
        made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
        yield Nodes(made)
        made.shutdown()


on_a_cluster = [
    pytest.mark.slow,
    # Ray itself leaves sockets and processes to the garbage collector.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]


def marked(test: Callable[..., None]) -> Callable[..., None]:
    """Mark a test that needs a real cluster."""
    for mark in on_a_cluster:
        test = mark(test)
    return test


@marked
def test_nodes_killed_in_mid_run_lose_nothing_also_when_none_is_left(
    cluster: Nodes, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    requests = make_requests(192)
    setups = load_setups(requests, read_grasps())
    nodes = [cluster.add(), cluster.add()]
    added: list[Any] = []

    def disturb(share: float, message: str) -> None:
        if (share >= 1 / 6 and len(nodes) == 2) or (share >= 1 / 2 and nodes):
            cluster.kill(nodes.pop())

    class AddsWhenTold(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if "no node of the Ray cluster" in record.getMessage() and not added:
                added.append(cluster.add())

    logger, handler = logging.getLogger("graspcast"), AddsWhenTold()
    logger.addHandler(handler)
    try:
        executor = RayExecutor(cluster.address)
        outcomes = run_campaign(
            requests, setups, tmp_path / "ray", executor=executor, progress=disturb
        )
    finally:
        logger.removeHandler(handler)
        for node in (*nodes, *added):
            cluster.kill(node)
    assert not nodes and added
    local = run_campaign(requests, setups, tmp_path / "local", executor=LocalExecutor(1))
    assert outcomes.drop("computed_s").equals(local.drop("computed_s"))
    assert "again" in caplog.text


@marked
def test_nodes_without_graspcast_or_with_another_version_are_named(
    cluster: Nodes, trials: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "old" / "graspcast").mkdir(parents=True)
    (tmp_path / "old" / "graspcast" / "__init__.py").write_text('__version__ = "0.0.9"')
    (tmp_path / "none").mkdir()
    (tmp_path / "none" / "sitecustomize.py").write_text(
        "import sys\n"
        "class Without:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'graspcast':\n"
        "            raise ModuleNotFoundError('No module named graspcast', name=name)\n"
        "sys.meta_path.insert(0, Without())\n"
    )
    nodes = []
    for name in ("old", "none"):
        monkeypatch.setenv("PYTHONPATH", str(tmp_path / name))
        nodes.append(cluster.add())
    monkeypatch.setenv("PYTHONPATH", str(SOURCE))
    try:
        with pytest.raises(CampaignStoppedError) as stopped:
            run_campaign(*trials, tmp_path / "out", executor=RayExecutor(cluster.address))
    finally:
        for node in nodes:
            cluster.kill(node)
    said = str(stopped.value)
    assert "has graspcast 0.0.9 (here " in said
    assert "has no graspcast" in said
