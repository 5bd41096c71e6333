"""Load on ``graspcast serve``: frames a second, latencies, memory, start, and a stop under load.

    python benchmarks/service_load.py --model demo --log

The service is started on the loopback of this machine, and asked by this process; both share its
cores. Frames show one instance of an object that the model knows, seen by all its estimators.

    start      seconds from the command to the first answer
    paced      frames that are sent at a fixed rate, whether answered or not; the latency of each
               counts from when it was due
    most       frames on so many connections, each sent when the one before was answered
    memory     resident memory of the service before and after --requests frames
    stop       SIGTERM while frames and outcomes are sent: outcomes that were acknowledged and are
               not in the log (needs --log); and the same with SIGKILL
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np


class Connection(asyncio.Protocol):
    """A connection that sends requests, one after another, and waits for each answer."""

    def __init__(self) -> None:
        self.buffer = b""
        self.answer: asyncio.Future[tuple[int, bytes]] | None = None

    def connection_made(self, transport: Any) -> None:
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self.buffer += data
        head, gap, body = self.buffer.partition(b"\r\n\r\n")
        if not gap:
            return
        length = int(head.lower().partition(b"content-length: ")[2].split(b"\r", 1)[0])
        if len(body) < length:
            return
        self.buffer = body[length:]
        answer, self.answer = self.answer, None
        if answer is not None and not answer.done():
            answer.set_result((int(head[9:12]), body[:length]))

    def connection_lost(self, exc: Exception | None) -> None:
        if self.answer is not None and not self.answer.done():
            self.answer.set_exception(ConnectionError("closed"))

    async def ask(self, request: bytes) -> tuple[int, bytes]:
        if self.transport.is_closing():
            raise ConnectionError("closed")
        self.answer = asyncio.get_running_loop().create_future()
        self.transport.write(request)
        return await self.answer


class Service:
    """The service in a process of its own."""

    def __init__(self, process: subprocess.Popen[bytes], port: int, start_s: float):
        self.process, self.port, self.start_s = process, port, start_s

    def request(self, path: str, content: Any) -> bytes:
        body = json.dumps(content).encode()
        head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        return f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body

    def get(self, path: str) -> str:
        url = f"http://127.0.0.1:{self.port}{path}"
        with urllib.request.urlopen(url, timeout=60) as answer:
            return str(answer.read().decode())

    def frame(self) -> bytes:
        (model, *_) = json.loads(self.get("/models"))["models"]
        name = next(iter(model["objects"]))
        estimates = {}
        for i, estimator in enumerate([model["principal"], *model["supporters"]]):
            pose = np.eye(4)
            pose[:3, 3] = 0.02 + 0.001 * i, -0.01, 0.7 + 0.002 * i
            estimates[estimator] = [{"object": name, "cam_T_obj": pose.tolist(), "score": 0.9}]
        given = {"length_unit": "m", "camera_frame": "opencv", "estimates": estimates}
        return self.request("/frames", given)

    def resident_mb(self) -> float:
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", status)[1]) / 1024  # type: ignore[index]

    def batches(self) -> tuple[float, float]:
        """Frames that were judged, and batches."""
        pattern = r"graspcast_batch_frames_(?:sum|count) (\S+)"
        count, total = map(float, re.findall(pattern, self.get("/metrics")))
        return total, count

    def cpu_s(self) -> float:
        parts = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(parts[11]) + int(parts[12])) / os.sysconf("SC_CLK_TCK")

    async def connect(self, count: int) -> list[Connection]:
        loop = asyncio.get_running_loop()
        made = [
            await loop.create_connection(Connection, "127.0.0.1", self.port) for _ in range(count)
        ]
        return [connection for _, connection in made]


@contextmanager
def served(options: argparse.Namespace, log: Path | None) -> Iterator[Service]:
    command = [sys.executable, "-m", "graspcast", "serve", "--port", "0"]
    command += [text for model in options.model for text in ("--model", model)]
    command += [*(("--log", str(log)) if log else ()), *options.serve]
    began = time.monotonic()
    with tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(command, stderr=errors)
        try:
            while not (found := re.search(rb'"url": "http://[^"]*:(\d+)"', _content(errors))):
                if process.poll() is not None:
                    raise SystemExit(_content(errors).decode())
                time.sleep(0.01)
            service = Service(process, int(found[1]), 0.0)
            asyncio.run(closed_loop(service, service.frame(), 1, lambda done: done >= 1))
            service.start_s = time.monotonic() - began
            yield service
        finally:
            process.kill()
            process.wait()


def _content(file: Any) -> bytes:
    return os.pread(file.fileno(), 1 << 20, 0)


async def closed_loop(
    service: Service, request: bytes, count: int, enough: Callable[[int], bool]
) -> tuple[np.ndarray, float, int]:
    """Ask on some connections, each again when answered; latencies, seconds in all, failures."""
    times: list[float] = []
    failed = 0

    async def one(connection: Connection) -> None:
        nonlocal failed
        while not enough(len(times)):
            sent = time.perf_counter()
            status, _ = await connection.ask(request)
            times.append(time.perf_counter() - sent)
            failed += status != 200

    connections = await service.connect(count)
    began = time.perf_counter()
    await asyncio.gather(*map(one, connections))
    spent = time.perf_counter() - began
    for connection in connections:
        connection.transport.close()
    return np.array(times), spent, failed


async def open_loop(
    service: Service, request: bytes, rate: float, seconds: float
) -> tuple[np.ndarray, float, int]:
    """Ask at a fixed rate; latencies from when each was due, seconds in all, failures."""
    free = await service.connect(64)
    everyone, times, tasks = list(free), [], set()
    failed = unsent = 0

    async def one(connection: Connection, due: float) -> None:
        nonlocal failed
        status, _ = await connection.ask(request)
        times.append(time.perf_counter() - due)
        failed += status != 200
        free.append(connection)

    began = time.perf_counter()
    for i in range(int(rate * seconds)):
        due = began + i / rate
        if (wait := due - time.perf_counter()) > 0:
            await asyncio.sleep(wait)
        while not free:
            unsent += 1
            await asyncio.sleep(0.0005)
        task = asyncio.create_task(one(free.pop(), due))
        tasks.add(task)
        task.add_done_callback(tasks.discard)
    await asyncio.gather(*tasks)
    spent = time.perf_counter() - began
    for connection in everyone:
        connection.transport.close()
    return np.array(times), spent, failed


def told(name: str, service: Service, ask: Any) -> None:
    before, cpu, own = service.batches(), service.cpu_s(), time.process_time()
    times, spent, failed = asyncio.run(ask)
    cpu, own = service.cpu_s() - cpu, time.process_time() - own
    frames, count = np.subtract(service.batches(), before)
    ms = 1e3 * np.percentile(times, [50, 95, 99, 100])
    parts = (
        f"{name:<18}{len(times) / spent:8.0f} frames/s",
        f"p50 {ms[0]:.1f}  p95 {ms[1]:.1f}  p99 {ms[2]:.1f}  max {ms[3]:.1f} ms",
        f"failed {failed}",
        f"{frames / count:.1f} a batch",
        f"processor a frame: service {1e3 * cpu / len(times):.2f} ms, "
        f"this {1e3 * own / len(times):.2f} ms",
    )
    print("   ".join(parts), flush=True)


async def outcomes_until_killed(service: Service, number: int, seconds: float) -> dict[str, bool]:
    """Send frames, and an outcome of each decision, until the service ends; acknowledged ones."""
    frame, known = service.frame(), {}

    async def one(connection: Connection, i: int) -> None:
        n = 0
        try:
            while True:
                status, body = await connection.ask(frame)
                if status != 200:
                    return
                for decision in json.loads(body)["decisions"]:
                    n += 1
                    given = {"decision_id": decision["id"], "success": (i + n) % 3 > 0}
                    status, _ = await connection.ask(service.request("/outcomes", given))
                    if status == 200:
                        known[decision["id"]] = given["success"]
        except ConnectionError:
            return

    asyncio.get_running_loop().call_later(seconds, service.process.send_signal, number)
    connections = await service.connect(16)
    await asyncio.gather(*(one(c, i) for i, c in enumerate(connections)))
    return known


def stopped(options: argparse.Namespace, number: int, rounds: int) -> None:
    from graspcast.attempt_log.log import AttemptLog

    acknowledged = lost = wrong = 0
    codes = set()
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "attempts.log"
        for i in range(rounds):
            with served(options, log) as service:
                known = asyncio.run(outcomes_until_killed(service, number, 1.0 + 0.37 * (i % 5)))
                codes.add(service.process.wait(timeout=60))
            with AttemptLog.read(log) as reader:
                table = reader.outcomes()
                recorded = dict(zip(table["decision_id"], table["success"], strict=True))
            acknowledged += len(known)
            lost += sum(name not in recorded for name in known)
            wrong += sum(recorded.get(name, value) != value for name, value in known.items())
    print(
        f"{signal.Signals(number).name:<18}{rounds} times, exit codes {sorted(codes)}: "
        f"{acknowledged} outcomes acknowledged, {lost} of them lost, {wrong} wrong",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--model", action="append", required=True)
    parser.add_argument("--log", action="store_true", help="keep an attempt log")
    parser.add_argument("--requests", type=int, default=200_000, help="of the memory's test")
    parser.add_argument("--rate", type=float, default=1000.0, help="frames a second, paced")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each measurement")
    parser.add_argument("--connections", type=int, action="append", default=[])
    parser.add_argument("--stops", type=int, default=5, help="of each kind")
    parser.add_argument("serve", nargs="*", help="further options of graspcast serve, after --")
    options = parser.parse_args()
    print(f"cores {os.cpu_count()}, load before {os.getloadavg()[0]:.2f}")
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "attempts.log" if options.log else None
        with served(options, log) as service:
            print(f"{'start':<18}{service.start_s:8.2f} s to the first answer")
            frame, seconds = service.frame(), options.seconds
            asyncio.run(closed_loop(service, frame, 8, lambda done: done >= 500))
            told(
                f"paced {options.rate:.0f}/s", service,
                open_loop(service, frame, options.rate, seconds),
            )  # fmt: skip
            for count in options.connections or (1, 8, 16, 32):
                until = time.perf_counter() + seconds
                ask = closed_loop(service, frame, count, lambda _, u=until: time.perf_counter() > u)
                told(f"most, {count} conn.", service, ask)
            if options.requests:
                memory(service, frame, options.requests)
    if options.log and options.stops:
        stopped(options, signal.SIGTERM, options.stops)
        stopped(options, signal.SIGKILL, options.stops)


def memory(service: Service, frame: bytes, requests: int) -> None:
    parts = [service.resident_mb()]
    for _ in range(4):
        asyncio.run(closed_loop(service, frame, 16, lambda done: done >= requests // 4))
        parts.append(service.resident_mb())
    told_mb = " ".join(f"{part:.1f}" for part in parts)
    print(f"{'memory':<18}{told_mb} MB at the start and after each quarter of {requests} requests")


if __name__ == "__main__":
    main()
