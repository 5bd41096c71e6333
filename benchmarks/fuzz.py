"""Fuzzer over all readers: every input gives a result or a GraspcastError.

    python benchmarks/fuzz.py --inputs 1000000 --jobs 2 --seed 0

Valid files (``fuzz_readers.py``) are changed at random (``fuzz_mutations.py``) and read. Any other
exception, a death of the interpreter, more than 10 s and more than 1 GB are failures; the smallest
inputs of each kind are written to ``--corpus``. The inputs follow from the seed, the reader and
their number, so ``--readers NAME --first N --inputs 1`` repeats one. Exit code 1 after a failure.

A worker process reads one input after another in itself, since a process for each would take
longer than most reads. What it reads is first written to memory that it shares with the parent,
which knows from there what killed the worker, or what it hangs on.
"""

from __future__ import annotations

import argparse
import json
import mmap
import multiprocessing
import multiprocessing.connection
import os
import resource
import struct
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

SECONDS = 10.0
BYTES = 10**9
CHUNK = 250
LARGEST_INPUT = 2**22
KEPT = 3  # inputs of each kind of failure
_HEAD = struct.Struct("<dqqqq")  # begun, number, of which read, refused, length of the input


@dataclass
class Tally:
    """What became of a reader's inputs."""

    outcomes: Counter[str] = field(default_factory=Counter)
    failures: dict[str, list[tuple[int, bytes, str]]] = field(default_factory=dict)
    seconds: float = 0.0
    slowest: float = 0.0

    def fail(self, kind: str, number: int, content: bytes, trace: str) -> None:
        self.outcomes["failed"] += 1
        kept = self.failures.setdefault(kind, [])
        kept.append((number, content, trace))
        kept.sort(key=lambda entry: len(entry[1]))
        del kept[KEPT:]

    def add(self, other: Tally) -> None:
        self.outcomes += other.outcomes
        self.seconds += other.seconds
        self.slowest = max(self.slowest, other.slowest)
        for kind, entries in other.failures.items():
            self.failures.setdefault(kind, []).extend(entries)
            self.failures[kind].sort(key=lambda entry: len(entry[1]))
            del self.failures[kind][KEPT:]


# --- The worker -----------------------------------------------------------------------------------


def work(connection: Any, seeds: str, shared: str, seed: int) -> None:
    """Read the inputs of one chunk after another; runs in a process of its own."""
    import logging
    import shutil
    import warnings

    sys.path.insert(0, str(Path(__file__).parent))
    import fuzz_readers

    logging.disable()
    warnings.simplefilter("ignore")
    os.dup2(os.open(Path(shared).parent / "messages", os.O_WRONLY | os.O_CREAT | os.O_APPEND), 2)
    folder = Path(shared).parent / f"files-{os.getpid()}"
    shutil.copytree(seeds, folder)
    with open(shared, "r+b") as stream:  # noqa: PTH123
        memory = mmap.mmap(stream.fileno(), 0)
    for reader in fuzz_readers.READERS:
        reader.read(reader.path(folder))  # what is imported and compiled now is not counted below
    connection.send("ready")
    while chunk := connection.recv():
        name, first, count = chunk
        connection.send(_chunk(fuzz_readers.BY_NAME[name], folder, memory, seed, first, count))


def _chunk(
    reader: Any, folder: Path, memory: mmap.mmap, seed: int, first: int, count: int
) -> Tally:
    path = reader.path(folder)
    valid, tally = path.read_bytes(), Tally()
    begun = time.perf_counter()
    try:
        for number in range(first, first + count):
            random = Random(f"{seed}/{reader.name}/{number}")
            content = reader.mutated(valid, random)[:LARGEST_INPUT]
            head = time.monotonic(), number, tally.outcomes["read"], tally.outcomes["refused"]
            memory[_HEAD.size : _HEAD.size + len(content)] = content
            memory[: _HEAD.size] = _HEAD.pack(*head, len(content))
            start = time.perf_counter()
            kind, trace = attempt(reader, path, content)
            tally.slowest = max(tally.slowest, time.perf_counter() - start)
            if kind in ("read", "refused"):
                tally.outcomes[kind] += 1
            else:
                if kind not in tally.failures:
                    content = _smaller(reader, path, content, kind)
                tally.fail(kind, number, content, trace)
    finally:
        path.write_bytes(valid)
        memory[: _HEAD.size] = _HEAD.pack(0.0, -1, 0, 0, 0)
    tally.seconds = time.perf_counter() - begun
    return tally


def attempt(reader: Any, path: Path, content: bytes) -> tuple[str, str]:
    """Read one input; return "read", "refused" or the kind of failure, and the trace of it."""
    from graspcast.errors import GraspcastError

    path.write_bytes(content)
    before = _most_bytes()
    try:
        reader.read(path)
        kind, trace = "read", ""
    except GraspcastError:
        kind, trace = "refused", ""
    except BaseException as error:  # polars' PanicException is no Exception
        if isinstance(error, KeyboardInterrupt):
            raise
        trace = traceback.format_exc()
        frames = traceback.extract_tb(error.__traceback__)
        place = next((f for f in reversed(frames) if "graspcast" in f.filename), frames[-1])
        kind = f"{type(error).__name__} in {Path(place.filename).stem}.{place.name}"
    if (taken := _most_bytes() - before) > BYTES:
        return "memory", f"took {taken:,} bytes"
    return kind, trace


def _most_bytes() -> int:
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _smaller(reader: Any, path: Path, content: bytes, kind: str) -> bytes:
    """Cut parts off an input for as long as it fails in the same way, for at most a second."""
    end, size = time.perf_counter() + 1.0, max(1, len(content) // 2)
    while size and time.perf_counter() < end:
        at = 0
        while at < len(content) and time.perf_counter() < end:
            shorter = content[:at] + content[at + size :]
            if attempt(reader, path, shorter)[0] == kind:
                content = shorter
            else:
                at += size
        size //= 2
    return content


# --- The parent -----------------------------------------------------------------------------------


class Worker:
    """A worker process, replaced when it dies or is killed."""

    def __init__(self, number: int, folder: Path, seed: int):
        self.shared = folder / f"input-{number}"
        self.shared.write_bytes(bytes(_HEAD.size + LARGEST_INPUT))
        with self.shared.open("r+b") as stream:
            self.memory = mmap.mmap(stream.fileno(), 0)
        self.folder, self.seed = folder, seed
        self.chunk: tuple[str, int, int] | None = None
        self._start()

    def _start(self) -> None:
        self.memory[: _HEAD.size] = _HEAD.pack(0.0, -1, 0, 0, 0)
        context = multiprocessing.get_context("spawn")
        self.connection, other = context.Pipe()
        arguments = (other, str(self.folder / "seeds"), str(self.shared), self.seed)
        self.process = context.Process(target=work, args=arguments, daemon=True)
        self.process.start()
        other.close()
        self.ready = False
        self.base = 0

    def give(self, chunk: tuple[str, int, int]) -> None:
        self.chunk = chunk
        self.connection.send(chunk)

    def check(self) -> tuple[Tally | None, tuple[str, int, int] | None]:
        """Return a tally, if there is a new one, and what is left of a chunk that ended early."""
        with suppress(EOFError, ConnectionError):
            if self.connection.poll():
                message = self.connection.recv()
                if message == "ready":
                    self.ready, self.base = True, _resident(self.process.pid)
                    return None, None
                self.chunk = None
                return message, None
        begun, number, *_ = _HEAD.unpack(self.memory[: _HEAD.size])
        if not self.process.is_alive():
            return self._lost(f"crash, exit status {self.process.exitcode}")
        if number >= 0 and time.monotonic() - begun > SECONDS:
            return self._lost("hang")
        if self.ready and _resident(self.process.pid) - self.base > 2 * BYTES:
            return self._lost("memory")
        return None, None

    def _lost(self, kind: str) -> tuple[Tally | None, tuple[str, int, int] | None]:
        self.process.kill()
        self.process.join()
        head = _HEAD.unpack(self.memory[: _HEAD.size])
        _, number, read, refused, length = head
        chunk, self.chunk = self.chunk, None
        if chunk is None or number < 0:
            said = (self.folder / "messages").read_text(errors="replace")[-2000:]
            print(said, file=sys.stderr)
            raise SystemExit(f"a worker died between two inputs ({chunk}): {kind}")
        content = bytes(self.memory[_HEAD.size : _HEAD.size + length])
        tally = Tally(Counter(read=read, refused=refused), seconds=0.0)
        tally.fail(kind, number, content, "")
        name, first, count = chunk
        left = first + count - number - 1
        self._start()
        return tally, (name, number + 1, left) if left else None


def _resident(pid: int | None) -> int:
    with suppress(OSError, ValueError, IndexError):
        pages = Path(f"/proc/{pid}/statm").read_text().split()[1]
        return int(pages) * resource.getpagesize()
    return 0


def _chunks(counts: dict[str, int], first: int) -> Iterator[tuple[str, int, int]]:
    """Yield all chunks, the readers in turn."""
    done = dict.fromkeys(counts, 0)
    while left := [name for name in counts if done[name] < counts[name]]:
        for name in left:
            count = min(CHUNK, counts[name] - done[name])
            yield name, first + done[name], count
            done[name] += count


def run(
    counts: dict[str, int],
    tallies: dict[str, Tally],
    folder: Path,
    jobs: int,
    seed: int,
    first: int,
) -> None:
    """Read that many inputs of each reader, and add them up."""
    workers = [Worker(number, folder, seed) for number in range(jobs)]
    chunks, again = _chunks(counts, first), []
    start = said = time.monotonic()
    more = True
    while more or again or any(worker.chunk for worker in workers):
        for worker in workers:
            name = worker.chunk[0] if worker.chunk else ""
            tally, left = worker.check()
            if tally:
                tallies[name].add(tally)
                for kind, kept in tally.failures.items():
                    print(f"  {name}, input {kept[0][0]}: {kind}", flush=True)
            if left:
                again.append(left)
            if worker.ready and worker.chunk is None and (more or again):
                chunk = again.pop() if again else next(chunks, None)
                if chunk is None:
                    more = False
                else:
                    worker.give(chunk)
        multiprocessing.connection.wait([worker.connection for worker in workers], timeout=0.2)
        if time.monotonic() - said > 60:
            said = time.monotonic()
            done = sum(sum(t.outcomes.values()) for t in tallies.values())
            failed = sum(t.outcomes["failed"] for t in tallies.values())
            rate = done / (said - start)
            print(f"  {done:,} inputs, {failed} failed, {rate:.0f}/s", flush=True)
    for worker in workers:
        worker.connection.send(None)
        worker.process.join(10)


def report(tallies: dict[str, Tally], corpus: Path, seconds: float) -> dict[str, Any]:
    """Print a table, write the failing inputs, and return the figures."""
    print(f"{'reader':24}{'inputs':>9}{'read':>9}{'refused':>9}{'failed':>7}{'slowest s':>11}")
    figures: dict[str, Any] = {"seconds": seconds, "readers": {}}
    for name, tally in tallies.items():
        outcomes = tally.outcomes
        inputs = sum(outcomes.values())
        line = f"{name:24}{inputs:9,}{outcomes['read']:9,}{outcomes['refused']:9,}"
        print(f"{line}{outcomes['failed']:7,}{tally.slowest:11.2f}")
        kinds = {kind: [entry[0] for entry in kept] for kind, kept in tally.failures.items()}
        figures["readers"][name] = {**outcomes, "slowest_s": tally.slowest, "failures": kinds}
        for n, (kind, kept) in enumerate(sorted(tally.failures.items())):
            print(f"    {kind}: inputs {', '.join(str(entry[0]) for entry in kept)}")
            for k, (number, content, trace) in enumerate(kept):
                target = corpus / name / f"{n}-{k}{Path(name).suffix}"
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(content)
                target.with_suffix(".txt").write_text(f"{kind}, input {number}\n{trace}")
    total = sum((tally.outcomes for tally in tallies.values()), Counter())
    inputs = sum(total.values())
    rate = f"in {seconds:.0f} s ({inputs / seconds:.0f}/s)"
    print(
        f"{inputs:,} inputs of {len(tallies)} readers {rate}: "
        f"{total['read']:,} read, {total['refused']:,} refused, {total['failed']:,} failed"
    )
    return {**figures, "inputs": inputs, **total}


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--inputs", type=int, default=100_000, help="of all readers together")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--readers", nargs="+", default=[], help="only these")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--corpus", type=Path, default=Path("fuzz-corpus"))
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    sys.path.insert(0, str(Path(__file__).parent))
    import fuzz_readers

    chosen = [r for r in fuzz_readers.READERS if not options.readers or r.name in options.readers]
    weights = sum(reader.weight for reader in chosen)
    counts = {r.name: max(1, round(options.inputs * r.weight / weights)) for r in chosen}
    fast = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=fast if os.access(fast, os.W_OK) else None) as folder:
        seeds = Path(folder) / "seeds"
        seeds.mkdir()
        fuzz_readers.make_seeds(seeds)
        start = time.monotonic()
        tallies = {name: Tally() for name in counts}
        try:
            run(counts, tallies, Path(folder), options.jobs, options.seed, options.first)
        except KeyboardInterrupt:
            print("interrupted; what was read until now:")
        figures = report(tallies, options.corpus, time.monotonic() - start)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1))
    return int(figures.get("failed", 0) > 0)


if __name__ == "__main__":
    raise SystemExit(main())
