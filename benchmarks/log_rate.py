"""How many frames and outcomes a second an attempt log takes, each on disk when it returns.

    python benchmarks/log_rate.py

For one thread, whose every record waits for the disk, and for several, whose records are committed
together; and how large a decision is.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

from graspcast.attempt_log import AttemptLog, OutcomeRecord
from log_kills import made_frame


def rate(threads: int, seconds: float, each: Callable[[int, int], object]) -> float:
    """Return how many calls a second several threads make; one that returns False ends a thread."""
    counts = [0] * threads
    end = time.perf_counter() + seconds

    def work(thread: int) -> None:
        while time.perf_counter() < end:
            if each(thread, counts[thread]) is False:
                break
            counts[thread] += 1

    running = [threading.Thread(target=work, args=(n,)) for n in range(threads)]
    start = time.perf_counter()
    for thread in running:
        thread.start()
    for thread in running:
        thread.join()
    return sum(counts) / (time.perf_counter() - start)


def flushes(folder: Path, seconds: float = 1.0) -> float:
    """Return how many times a second a small write reaches the disk."""
    with (folder / "probe").open("wb") as stream:

        def once(thread: int, number: int) -> None:
            stream.write(bytes(4096))
            stream.flush()
            os.fdatasync(stream.fileno())

        return rate(1, seconds, once)


def main() -> None:
    """Print the rates."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--folder", type=Path, help="where the log is made (a local disk)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        print(f"4 KiB written and flushed: {flushes(Path(folder)):,.0f} a second")
        path = Path(folder) / "log.db"
        with AttemptLog.open(path) as log:
            for threads in (1, 4, 16, 64):
                made = [0] * threads

                def add(
                    thread: int, number: int, run: int = threads, made: list[int] = made
                ) -> None:
                    log.add([made_frame(f"{run}.{thread}.{number}", 1)])
                    made[thread] = number + 1

                def tell(
                    thread: int, number: int, run: int = threads, made: list[int] = made
                ) -> bool:
                    if number == made[thread]:
                        return False
                    log.add_outcome(OutcomeRecord(f"{run}.{thread}.{number}.0", True))
                    return True

                decisions = rate(threads, options.seconds, add)
                outcomes = rate(threads, options.seconds, tell)
                print(
                    f"{threads} threads: {decisions:,.0f} decisions a second, "
                    f"{outcomes:,.0f} outcomes a second"
                )

            def batch(thread: int, number: int) -> None:
                log.add([made_frame(f"b.{thread}.{number}.{i}", 1) for i in range(16)])

            batches = rate(1, options.seconds, batch)
            print(f"1 thread, 16 frames at a time: {16 * batches:,.0f} decisions a second")
        count = len(AttemptLog.read(path).decisions())
        print(f"{path.stat().st_size / count:,.0f} bytes a decision with three estimates")


if __name__ == "__main__":
    main()
