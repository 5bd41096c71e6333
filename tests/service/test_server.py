from __future__ import annotations

import re
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from graspcast.errors import InputError
from graspcast.service.server import listen
from service_client import Process, running, stub
from stub_watcher import frame


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "robot.example"])
def test_another_host_than_this_machine_needs_a_token(host: str) -> None:
    with pytest.raises(InputError, match=r"a token is needed: set .* GRASPCAST_TOKEN") as caught:
        listen(host, 0, None)
    assert caught.value.parameters == ("host",)


def test_with_a_token_any_address_serves() -> None:
    with listen("0.0.0.0", 0, 20 * "x") as listener:
        assert listener.getsockname()[1]


def test_an_address_that_is_taken_is_named() -> None:
    with listen("127.0.0.1", 0, None) as listener:
        port = listener.getsockname()[1]
        with pytest.raises(InputError, match=f"127.0.0.1, port {port}: cannot listen there"):
            listen("127.0.0.1", port, None)


def test_an_address_of_another_machine_is_refused() -> None:
    with pytest.raises(InputError, match="cannot listen there"):
        listen("192.0.2.1", 0, 20 * "x")


def accepted(service: Process) -> int:
    """How many frames wait, or are or were judged."""
    text = httpx.get(f"{service.url}/metrics", timeout=20).text
    waiting = re.search(r"^graspcast_waiting (\S+)", text, re.MULTILINE)
    assert waiting is not None
    taken = sum(line["frames"] for line in service.log() if line["event"] == "batch")
    return taken + int(float(waiting[1]))


@contextmanager
def asking(service: Process, count: int) -> Iterator[list[int]]:
    """Ask for verdicts at the same time, and wait until all are accepted; later, for answers."""
    statuses: list[int] = []

    def ask() -> None:
        try:
            response = httpx.post(f"{service.url}/frames", json=frame(), timeout=30)
            statuses.append(response.status_code)
        except httpx.HTTPError:
            statuses.append(0)

    threads = [threading.Thread(target=ask) for _ in range(count)]
    for thread in threads:
        thread.start()
    while accepted(service) < count:
        time.sleep(0.01)
    yield statuses
    for thread in threads:
        thread.join()


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow)]
)
@pytest.mark.slow
def test_a_stop_answers_what_was_accepted(tmp_path: Path, number: int) -> None:
    with running(stub(0.25, batch=4), tmp_path) as service:
        with asking(service, 8) as statuses:
            service.process.send_signal(number)
        assert statuses == 8 * [200]
        assert service.process.wait(timeout=20) == 0
        with pytest.raises(httpx.ConnectError):
            httpx.get(f"{service.url}/health")
        assert service.log()[-1]["event"] == "stopped"


@pytest.mark.slow
def test_a_second_signal_does_not_wait(tmp_path: Path) -> None:
    with running(stub(30.0), tmp_path) as service:
        with asking(service, 1) as statuses:
            service.process.send_signal(signal.SIGINT)
            time.sleep(0.1)
            service.process.send_signal(signal.SIGINT)
            service.process.wait(timeout=20)
        assert statuses[0] in (0, 500)
