"""Latency of answers at the robot: ``Watcher.judge`` and ``judge_all``, from a model file alone.

    python benchmarks/watcher.py --model model.npz --data published/ycbv

``--data`` has results files ``NAME_DATASET-test.csv`` by the model's estimators and, in
``camera_motion``, the camera's poses. Every frame has a pose by each estimator of each of its
instances; to have 20 of them, instances of other images of the scene are added. After ``warm_up``:
wall time and processor time of the calling thread of every call, in milliseconds, in all and per
instance.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from graspcast import Estimate, Frame, Watcher, read_camera_motion, read_results
from graspcast.estimates.alignment import align
from graspcast.estimates.instances import split_object_name

ALL = 1_000_000


def instances(watcher: Watcher, data: Path) -> dict[tuple[int, int], list[dict[str, Estimate]]]:
    """Scene and image to its instances: each estimator's estimate."""
    card = watcher.forecasters[0].card
    dataset, _ = split_object_name(card.objects[0])
    known = [split_object_name(name)[1] for name in card.objects]
    tables = {}
    for name in card.estimators:
        table = read_results(data / f"{name}_{dataset}-test.csv", lenient=True)
        tables[name] = table.select(np.isin(table.obj_id, known))
    every = align(tables, dataset=dataset, anchor=card.principal)
    out: dict[tuple[int, int], list[dict[str, Estimate]]] = {}
    for i, key in enumerate(every.instances.to_keys()):
        poses = zip(every.estimators, every.cam_T_obj[:, i], strict=True)
        each = {name: Estimate(key.object, pose, 1.0 - 0.01 * key.est_id) for name, pose in poses}
        out.setdefault((key.scene_id, key.im_id), []).append(each)
    return out


def frame(found: Iterable[dict[str, Estimate]], world_T_cam: Any) -> Frame:
    estimates: dict[str, list[Estimate]] = {}
    for each in found:
        for name, estimate in each.items():
            estimates.setdefault(name, []).append(estimate)
    return Frame(estimates, world_T_cam)


def frames(
    found: dict[tuple[int, int], list[dict[str, Estimate]]], motion: Any, count: int, most: int
) -> list[Frame]:
    """Frames of ``count`` instances, filled up with those of other images of the scene."""
    out = []
    for key, own in found.items():
        if count == ALL:
            out.append(frame(own, motion.world_T_cam.get(key)))
            continue
        pool = own + [
            e for other, some in found.items() if other[0] == key[0] != other for e in some
        ]
        if len(pool) >= count:
            out.append(frame(pool[:count], motion.world_T_cam.get(key)))
        if len(out) == most:
            break
    return out


def predicting(watcher: Watcher) -> Callable[[Frame], Any]:
    """The verdict without anything around it, for comparison."""
    forecaster = watcher.forecasters[0]

    def call(given: Frame) -> Any:
        poses = {name: some[0].cam_T_obj for name, some in given.estimates.items()}
        name = next(iter(given.estimates.values()))[0].object_name
        assert forecaster.known is not None
        return forecaster.predict(poses, name, models=forecaster.known.models)

    return call


def timed(call: Callable[[Any], Any], given: Iterable[Any]) -> np.ndarray:
    out = []
    for each in given:
        wall, thread = time.perf_counter(), time.thread_time()
        call(each)
        out.append((time.perf_counter() - wall, time.thread_time() - thread))
    return np.array(out) * 1e3


def show(what: str, took: np.ndarray, per: float = 1.0) -> None:
    wall, thread = took.T
    print(
        f"{what:34s} {np.median(wall):8.2f} {np.quantile(wall, 0.99):8.2f} "
        f"{np.median(thread):8.2f} {np.median(thread) / per:8.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default="demo")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--threshold", type=float, default=0.8)
    parser.add_argument("--calls", type=int, default=200)
    options = parser.parse_args()
    watcher = Watcher.load(options.model, threshold=options.threshold)
    start = time.perf_counter()
    watcher.warm_up()
    print(f"warm_up {time.perf_counter() - start:.2f} s")
    found = instances(watcher, options.data)
    motion = read_camera_motion(options.data / "camera_motion")
    print(f"{'ms':34s} {'median':>8s} {'p99':>8s} {'cpu':>8s} {'cpu/inst':>8s}")
    one = frames(found, motion, 1, options.calls)
    actions = Counter(d.action for f in one for d in watcher.judge(f))
    show("Forecaster.predict, 1 instance", timed(predicting(watcher), one))
    for count in (1, 5, 20):
        some = frames(found, motion, count, options.calls)
        if some:
            show(f"first look, {count} instances", timed(watcher.judge, some), count)
    for size in (16, 64):
        batches = [one[i : i + size] for i in range(0, len(one) - size + 1, size)]
        if batches:
            show(f"batch of {size} frames of 1 instance", timed(watcher.judge_all, batches), size)
    first = [watcher.judge(f).episode for f in one]
    seen = dict(zip(first, [*one[1:], one[0]], strict=True))
    show("second look, 1 instance", timed(lambda e: watcher.judge(seen[e], e), first))
    print("verdicts on one instance:", dict(actions))


if __name__ == "__main__":
    main()
