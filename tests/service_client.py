"""The service in this process, and in one of its own, for tests."""

from __future__ import annotations

import asyncio
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx

from graspcast.service.app import create_app

TESTS = Path(__file__).parent
PATHS = os.pathsep.join([str(TESTS.parent / "src"), str(TESTS)])
# Without lines of progress, which a slow start would put among those of the log.
ENVIRONMENT = {**os.environ, "PYTHONPATH": PATHS, "GRASPCAST_PROGRESS_S": "0"}


def asked(watcher: Any, *requests: tuple[str, str, dict[str, Any]], **options: Any) -> list[Any]:
    """Ask a new service all requests at once, and return the responses."""

    async def ask() -> list[Any]:
        app = create_app(watcher, **options)
        transport = httpx.ASGITransport(app)
        async with (
            lifespan(app),
            httpx.AsyncClient(transport=transport, base_url="http://localhost") as client,
        ):
            waiting = [client.request(m, path, **given) for m, path, given in requests]
            return await asyncio.gather(*waiting)

    return asyncio.run(ask())


class lifespan:  # noqa: N801
    """What a server does with an application before and after its requests."""

    def __init__(self, app: Any):
        self._app = app
        self._queue: asyncio.Queue[dict[str, str]] = asyncio.Queue()
        self._sent: asyncio.Queue[Any] = asyncio.Queue()

    async def __aenter__(self) -> None:
        scope = {"type": "lifespan", "asgi": {"version": "3.0"}, "state": {}}
        self._task = asyncio.create_task(self._app(scope, self._queue.get, self._sent.put))
        await self._tell("startup")

    async def __aexit__(self, *_: object) -> None:
        await self._tell("shutdown")
        await self._task

    async def _tell(self, event: str) -> None:
        await self._queue.put({"type": f"lifespan.{event}"})
        assert (await self._sent.get())["type"] == f"lifespan.{event}.complete"


class Process:
    """A service in a process of its own."""

    def __init__(self, process: subprocess.Popen[bytes], log: Path, url: str):
        self.process, self.url, self._log = process, url, log
        host, _, port = url.removeprefix("http://").rpartition(":")
        self.address = host, int(port)

    def sent(self, data: bytes, *, timeout: float = 20.0) -> bytes:
        """Send bytes, and return all that comes back until the connection is closed."""
        with socket.create_connection(self.address, timeout=timeout) as connection:
            connection.sendall(data)
            return read_all(connection)

    def stop(self) -> int:
        """Stop it as a system does, and return its exit code."""
        self.process.terminate()
        return self.process.wait(timeout=30)

    def log(self) -> list[dict[str, Any]]:
        """Return the lines of its log."""
        whole = self._log.read_text().rpartition("\n")[0]  # the last one may be half written
        # On a busy machine it says before how long it takes to start.
        return [json.loads(line) for line in whole.splitlines() if not line.startswith("serve: ")]


def read_all(connection: socket.socket) -> bytes:
    parts = []
    while part := connection.recv(65536):
        parts.append(part)
    return b"".join(parts)


@contextmanager
def running(command: Sequence[str], folder: Path, **environment: str) -> Iterator[Process]:
    """Run a command that serves, and wait until it says where."""
    log = folder / f"service-{len(list(folder.iterdir()))}.log"
    with log.open("wb") as file:
        process = subprocess.Popen(
            [sys.executable, *command],
            stderr=file,
            env={**ENVIRONMENT, **environment},
        )
    try:
        yield Process(process, log, _url(process, log))
    finally:
        process.terminate()  # what is killed cannot say which lines it ran
        try:
            process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _url(process: subprocess.Popen[bytes], log: Path) -> str:
    until = time.monotonic() + 60
    while time.monotonic() < until:
        for line in log.read_text().splitlines(keepends=True):
            if '"listening"' in line and line.endswith("\n"):
                return str(json.loads(line)["url"])
        if process.poll() is not None:
            break
        time.sleep(0.02)
    raise AssertionError(log.read_text())


def stub(seconds: float = 0.0, **limits: float) -> list[str]:
    """Return the command that serves a stub, with limits."""
    pairs = [f"{name}={value}" for name, value in limits.items()]
    return [str(TESTS / "stub_watcher.py"), str(seconds), *pairs]
