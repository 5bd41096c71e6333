"""Latency of a robot's looks: ``Episode.look`` with the first, second and third look at an object.

    python benchmarks/episodes.py --model model.npz --bop ycbv --camera-poses ycbv/camera_motion \\
      --estimates epos=epos_ycbv-test.csv --estimates gdrnpp=gdrnpp_ycbv-test.csv \\
      --estimates zebrapose=zebrapose_ycbv-test.csv

Each episode has three looks at an object of a scene, a third of the scene's images apart. Wall time
of every call after ``warm_up``, in milliseconds, and processor time of the calling thread; with the
verdicts that were given.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from graspcast import (
    BopDataset,
    CameraMotion,
    CameraNoise,
    Episode,
    Forecaster,
    Results,
    read_camera_motion,
    read_results,
)

Poses = dict[str, np.ndarray]


def episodes(
    results: dict[str, Results], motion: CameraMotion, objects: set[int]
) -> Iterator[tuple[int, list[tuple[Poses, np.ndarray]]]]:
    """Yield an object and three looks: each estimator's pose, and the camera's."""
    found: dict[tuple[int, int, int], Poses] = {}
    for name, table in results.items():
        keys = zip(table.scene_id, table.obj_id, table.im_id, table.cam_T_obj, strict=True)
        for scene_id, obj_id, im_id, pose in keys:
            found.setdefault((int(scene_id), int(obj_id), int(im_id)), {})[name] = pose
    images: dict[tuple[int, int], list[int]] = {}
    for scene_id, obj_id, im_id in sorted(found):
        whole = len(found[scene_id, obj_id, im_id]) == len(results)
        if whole and obj_id in objects and (scene_id, im_id) in motion.world_T_cam:
            images.setdefault((scene_id, obj_id), []).append(im_id)
    for (scene_id, obj_id), some in images.items():
        third = len(some) // 3
        for i in range(third):
            three = some[i], some[i + third], some[i + 2 * third]
            yield (
                obj_id,
                [(found[scene_id, obj_id, j], motion.world_T_cam[scene_id, j]) for j in three],
            )


def main() -> None:
    parser = argparse.ArgumentParser(description="Latency of a robot's looks.")
    parser.add_argument("--model", type=Path, required=True, help="trained with views")
    parser.add_argument("--estimates", action="append", required=True, metavar="NAME=FILE")
    parser.add_argument("--bop", type=Path, required=True)
    parser.add_argument("--camera-poses", type=Path, required=True)
    parser.add_argument("--guide", default="fused")
    parser.add_argument("--threshold", type=float, default=0.8)
    options = parser.parse_args()
    forecaster = Forecaster.load(options.model)
    dataset = BopDataset(options.bop)
    models = {dataset.name: dataset.models}
    results = {n: read_results(p) for n, _, p in (e.partition("=") for e in options.estimates)}
    motion = read_camera_motion(options.camera_poses)
    forecaster.warm_up(models)
    noise = CameraNoise(translation_m=0.001, rotation_rad=0.0017)
    wall: list[list[float]] = [[], [], []]
    cpu: list[list[float]] = [[], [], []]
    said: list[Counter[str]] = [Counter(), Counter(), Counter()]
    for obj_id, looks in episodes(results, motion, set(dataset.models.info)):
        episode = Episode(
            forecaster,
            f"{dataset.name}-{obj_id}",
            models=models,
            threshold=options.threshold,
            guide=options.guide,
            noise=noise,
        )
        for i, (poses, world_T_cam) in enumerate(looks):
            started, used = time.perf_counter(), time.thread_time()
            verdict = episode.look(poses, world_T_cam)
            cpu[i].append(time.thread_time() - used)
            wall[i].append(time.perf_counter() - started)
            said[i][str(verdict)] += 1
    print(f"{len(wall[0])} episodes")
    for i, counts in enumerate(said):
        times = [f"p{p} {1e3 * np.percentile(wall[i], p):.1f}" for p in (50, 99)]
        mine = f"{1e3 * np.percentile(cpu[i], 50):.1f}"
        given = ", ".join(f"{n} {what}" for what, n in sorted(counts.items()))
        print(f"look {i + 1}: {', '.join(times)} ms (processor p50 {mine} ms); {given}")


if __name__ == "__main__":
    main()
