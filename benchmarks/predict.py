"""Speed of a forecaster: import, 10,000 instances, one verdict; file size and training time.

    python benchmarks/predict.py [--calls 10000] [--rate 100] [--json predict.json]
        [--latency-only] [--grasps 30]

Estimates and meshes are synthetic, of realistic size (three estimators, objects of 8,000
vertices), so no data is needed. Each figure is the best of several runs in this process; the import
is that of a new one. The latency of single verdicts is that of every call: by a process that is
alone; beside two processes of the same priority that never pause, one call after the other and at
regular intervals, as a robot calls; and from eight threads at once, whose verdicts are compared
with the others. At intervals, a latency starts when the call is due, so it includes the time until
the scheduler wakes the process. First verdicts are those of new processes. What else runs on the
machine counts too, but for the processor times (of the calling thread, and per call of the whole
process): see the load that is printed.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from graspcast import (
    Estimates,
    Forecaster,
    TrainingData,
    Verdict,
    train_forecaster,
)
from graspcast.bop.models import Models
from graspcast.bop.results import Results, read_results, write_results
from graspcast.estimates.alignment import align
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings
from graspcast.forecasting.verdict import verdict_rows
from graspcast.forecasting.verdict_file import write_verdicts
from graspcast.pose.transforms import rotation_from_quaternion, transform

N = 10_000
NAMES = ("first", "second", "third")
WAYS = (("blend", "rich"), ("MLP-O", "paper"), ("MLP-O", "rich"))


def best(function: Callable[[], object], runs: int) -> float:
    """Seconds of the fastest run."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def made_up_results(rng: np.random.Generator) -> dict[str, Results]:
    rotation = rotation_from_quaternion(rng.normal(size=(N, 4)))
    translation = rng.normal(scale=0.1, size=(N, 3)) + [0, 0, 1]
    out = {}
    for name in NAMES:
        noise = rng.normal(scale=0.01, size=(N, 3))
        out[name] = Results(
            scene_id=np.ones(N, np.int64),
            im_id=np.arange(N) // 4,
            obj_id=np.arange(N) % 4 + 1,
            score=np.ones(N),
            cam_T_obj=transform(rotation, translation + noise),
            time_s=np.full(N, -1.0),
            line=np.arange(N),
        )
    return out


def made_up_models(folder: Path, rng: np.random.Generator) -> Models:
    info = {}
    for number in range(1, 5):
        points = rng.uniform(-50, 50, size=(8000, 3)).astype("<f4")
        points[:2] = [[-50], [50]]  # corners, so that the diameter is that of the cube
        header = "ply\nformat binary_little_endian 1.0\nelement vertex 8000\n"
        header += "".join(f"property float {a}\n" for a in "xyz") + "end_header\n"
        (folder / f"obj_{number:06d}.ply").write_bytes(header.encode() + points.tobytes())
        sizes = {f"min_{a}": -50.0 for a in "xyz"} | {f"size_{a}": 100.0 for a in "xyz"}
        info[str(number)] = {"diameter": 173.2} | sizes
    (folder / "models_info.json").write_text(json.dumps(info))
    return Models(folder)


def main() -> None:
    parser = argparse.ArgumentParser(description="Speed of a forecaster.")
    parser.add_argument("--calls", type=int, default=10_000, help="single verdicts that are timed")
    parser.add_argument("--rate", type=float, default=100.0, help="calls a second, at intervals")
    parser.add_argument("--json", type=Path, help="also write the latencies to this file")
    parser.add_argument("--latency-only", action="store_true", help="of the default method")
    parser.add_argument("--grasps", type=int, default=1, help="of each object, all ranked")
    args = parser.parse_args()
    ways = WAYS[:1] if args.latency_only else WAYS
    command = [sys.executable, "-c", "import graspcast"]
    bare = best(lambda: subprocess.run([sys.executable, "-c", ""], check=True), 5)
    print(f"import graspcast: {best(lambda: subprocess.run(command, check=True), 5) - bare:.3f} s")
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        models = {"made": made_up_models(Path(folder), rng)}
        paths = {}
        for name, results in made_up_results(rng).items():
            paths[name] = Path(folder) / f"{name}_made-test.csv"
            write_results(paths[name], results)
        tables = {name: read_results(path) for name, path in paths.items()}
        estimates = align(tables, dataset="made", anchor="first")
        data = made_up_training_data(estimates, rng, args.grasps).select(np.arange(2000))
        settings = NetworkSettings(optimiser=MlpSettings(epochs=20))
        for method, features in ways:
            start = time.perf_counter()
            forecaster = train_forecaster(
                data, method=method, features=features, settings=settings, models=models
            )
            trained = time.perf_counter() - start
            file = Path(folder) / "model.npz"
            forecaster.save(file)
            name = forecaster.card.method + " " + forecaster.card.features
            print(
                f"{name}: trained on {len(data)} in {trained:.1f} s, "
                f"{file.stat().st_size / 1e6:.2f} MB; loaded in "
                f"{1000 * best(lambda file=file: Forecaster.load(file), 5):.0f} ms"
            )
            if not args.latency_only:
                time_it(forecaster, name, estimates, models, paths)
            if (method, features) == WAYS[0]:
                figures = latencies(file, models["made"], estimates, args.calls, args.rate)
                if args.json:
                    args.json.write_text(json.dumps(figures, indent=2) + "\n")


def made_up_training_data(
    estimates: Estimates, rng: np.random.Generator, grasps: int = 1
) -> TrainingData:
    """True poses near the estimates, and grasps that succeed with errors below two centimetres."""
    truth = estimates.of("first").copy()
    truth[:, :3, 3] += rng.normal(scale=0.01, size=(len(truth), 3))
    off = np.linalg.norm(estimates.cam_T_obj[:, :, :3, 3] - truth[:, :3, 3], axis=2)
    others = {f"g{i}": (off < 0.01 + 0.001 * i).astype(float) for i in range(1, grasps)}
    held = (off < 0.02).astype(float)
    return TrainingData(estimates, "first", "parallel", truth, held, others=others)


def time_it(
    forecaster: Forecaster,
    name: str,
    estimates: Estimates,
    models: dict[str, Models],
    paths: dict[str, Path],
) -> None:
    one = {name: estimates.of(name)[0] for name in NAMES}

    def answer(estimates: Estimates = estimates) -> None:
        verdicts = forecaster.verdicts(estimates, models)
        rows = verdict_rows(estimates, verdicts, principal=NAMES[0], gripper="parallel")
        write_verdicts(paths["first"].with_name("verdicts.csv"), rows)

    def whole() -> None:
        read = {name: read_results(path) for name, path in paths.items()}
        answer(align(read, dataset="made", anchor="first"))

    def single() -> Verdict:
        return forecaster.predict(one, "made-1", models=models)

    single(), answer()  # compiled and loaded
    print(
        f"{name}: {N} instances {best(answer, 3):.2f} s, with reading three CSVs "
        f"{best(whole, 3):.2f} s; one verdict {1000 * best(single, 200):.2f} ms"
    )


FIRST = """
import sys, time
import numpy as np
from graspcast import Forecaster
from graspcast.bop.models import Models

forecaster, models = Forecaster.load(sys.argv[1]), {"made": Models(sys.argv[2])}
poses = {name: np.eye(4) for name in forecaster.card.estimators}
for i, pose in enumerate(poses.values()):
    pose[:3, 3] = 0.001 * i, 0.0, 1.0
start = time.perf_counter()
if sys.argv[3] == "warm":
    forecaster.warm_up(models)
warm = time.perf_counter()
verdict = forecaster.predict(poses, "made-1", models=models)
print(warm - start, time.perf_counter() - warm)
assert verdict.probability is not None, verdict
"""


Timed = tuple[float, float, float | None]
"""Seconds until a verdict, processor time of its thread, and the probability."""


def latencies(
    file: Path, models: Models, estimates: Estimates, calls: int, rate: float
) -> dict[str, object]:
    """Time single verdicts one by one, and the first ones of new processes."""
    forecaster, given = Forecaster.load(file), {"made": models}
    forecaster.warm_up(given)

    def timed(i: int, due: float | None = None) -> Timed:
        poses = dict(zip(estimates.estimators, estimates.cam_T_obj[:, i], strict=True))
        if due is not None:
            time.sleep(max(0.0, due - time.perf_counter()))
        computed, start = time.thread_time(), due or time.perf_counter()
        verdict = forecaster.predict(poses, f"made-{estimates.obj_id[i]}", models=given)
        stop = time.perf_counter()
        return stop - start, time.thread_time() - computed, verdict.probability

    def one_by_one() -> list[Timed]:
        return [timed(i % N) for i in range(calls)]

    def at_intervals() -> list[Timed]:
        return [timed(i % N, time.perf_counter() + 1 / rate) for i in range(calls)]

    def by_threads() -> list[Timed]:
        with ThreadPoolExecutor(8) as pool:
            return list(pool.map(timed, (i % N for i in range(calls))))

    columns = (
        "p50",
        "p90",
        "p99",
        "max",
        "thread_cpu_p50",
        "thread_cpu_p99",
        "process_cpu",
        "load",
    )
    print(f"{calls} verdicts, ms".ljust(36) + " ".join(f"{name:>10s}" for name in columns))
    out: dict[str, object] = {"calls": calls, "rate": rate}
    expected: list[float | None] = []
    for name, busy, ask in (
        ("alone", 0, one_by_one),
        ("two busy processes", 2, one_by_one),
        (f"two busy processes, {rate:g} a second", 2, at_intervals),
        ("eight threads", 0, by_threads),
    ):
        with busy_processes(busy):
            start = time.process_time()
            found = ask()
            each = (time.process_time() - start) / calls
        probabilities = [probability for *_, probability in found]
        expected = expected or probabilities
        assert probabilities == expected, name
        waited, computed = 1000 * np.array([times for *times, _ in found]).T
        values = (
            *np.percentile(waited, (50, 90, 99, 100)).tolist(),
            *np.percentile(computed, (50, 99)).tolist(),
            1000 * each,
            os.getloadavg()[0],
        )
        print(name.ljust(36) + " ".join(f"{value:10.2f}" for value in values))
        out[name] = dict(zip(columns, values, strict=True))
    for way in ("cold", "warm"):
        command = [sys.executable, "-c", FIRST, str(file), str(models.directory), way]
        runs = [subprocess.check_output(command, text=True).split() for _ in range(3)]
        warming, first = (1000 * min(map(float, times)) for times in zip(*runs, strict=True))
        print(f"first verdict, {way}: {first:.2f} ms" + f" after {warming:.0f} ms of warm_up()")
        out[f"first verdict, {way}"] = {"warm_up": warming, "first": first}
    return out


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """Keep processors busy meanwhile."""
    command = [sys.executable, "-c", "while True: pass"]
    processes = [subprocess.Popen(command) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


if __name__ == "__main__":
    main()
