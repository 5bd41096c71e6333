"""Commands of the CLI, with networks of few epochs, on a dataset "made" of one object."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import polars as pl

from graspcast.bop.results import write_results
from graspcast.bop.units import millimetres
from poses import nudged, random_poses, results_of, write_models

N = 60


def write_made(tmp_path: Path) -> Path:
    """Write a dataset "made" of one object, three estimators' CSVs, ground truth and outcomes."""
    bop = tmp_path / "made"
    write_models(bop / "models", obj_1={}, obj_2={})
    camera = {"fx": 570.0, "fy": 570.0, "cx": 320.0, "cy": 240.0}
    (bop / "camera.json").write_text(json.dumps(camera))
    truth = random_poses(N)
    for scene in range(6):
        folder = bop / "test" / f"{scene:06d}"
        folder.mkdir(parents=True)
        images = {
            str(i): [
                {
                    "obj_id": 1,
                    "cam_R_m2c": truth[i, :3, :3].ravel().tolist(),
                    "cam_t_m2c": millimetres(truth[i, :3, 3]).tolist(),
                }
            ]
            for i in range(scene, N, 6)
        }
        (folder / "scene_gt.json").write_text(json.dumps(images))
    outcomes = []
    for k, name in enumerate("abc"):
        poses = nudged(truth, k, metres=0.02)
        table = dataclasses.replace(results_of(poses), scene_id=np.arange(N) % 6)
        write_results(tmp_path / f"{name}_made-test.csv", table)
        error = np.linalg.norm(poses[:, :3, 3] - truth[:, :3, 3], axis=-1)
        outcomes += [
            (name, "made", i % 6, i, 1, "parallel", int(error[i] < 0.03)) for i in range(N)
        ]
    columns = ["estimator", "dataset", "scene_id", "im_id", "obj_id", "gripper", "success"]
    pl.DataFrame(outcomes, schema=columns, orient="row").write_csv(tmp_path / "outcomes.csv")
    return tmp_path


def inputs(world: Path, names: str = "abc") -> list[str]:
    out = ["--bop", str(world / "made")]
    for name in names:
        out += ["--estimates", f"{name}={world / f'{name}_made-test.csv'}"]
    return out


def train(world: Path, *more: str, names: str = "abc") -> list[str]:
    out = ["train", *inputs(world, names), "--principal", "a", "--gripper", "parallel"]
    out += ["--outcomes", str(world / "outcomes.csv"), "--out", str(world / "m.npz")]
    return [*out, "--epochs", "30", "--members", "2", *more]


def predict(world: Path, *more: str, names: str = "abc") -> list[str]:
    paths = ["--model", str(world / "m.npz"), "--out", str(world / "v.csv")]
    return ["predict", *inputs(world, names), *paths, *more]
