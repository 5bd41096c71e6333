"""Commands of the CLI, with small forests, on a dataset "made" of two objects."""

from __future__ import annotations

import csv
import dataclasses
import json
from pathlib import Path

import numpy as np
import polars as pl

import synthetic
from graspcast.bop.results import Results, write_results
from graspcast.bop.units import millimetres
from graspcast.cli import main
from graspcast.estimates.outcomes import ERROR_COLUMNS, error_numbers
from poses import results_of, write_models

N, SCENES, UNUSUAL = 120, 6, 7


def tables() -> dict[str, Results]:
    given = synthetic.training_data(N, scenes=SCENES).estimates
    return {
        name: dataclasses.replace(
            results_of(given.of(name)), scene_id=given.scene_id, obj_id=given.obj_id
        )
        for name in given.estimators
    }


def write_trained(root: Path) -> None:
    """Write estimates, ground truth and outcomes of two objects, a campaign, and three models."""
    write_models(root / "made" / "models", obj_1={}, obj_2={})
    given = synthetic.training_data(N, scenes=SCENES)
    estimates = given.estimates
    for scene in range(SCENES):
        folder = root / "made" / "test" / f"{scene:06d}"
        folder.mkdir(parents=True)
        images = {
            str(i): [
                {
                    "obj_id": int(estimates.obj_id[i]),
                    "cam_R_m2c": given.truth[i, :3, :3].ravel().tolist(),
                    "cam_t_m2c": millimetres(given.truth[i, :3, 3]).tolist(),
                }
            ]
            for i in np.flatnonzero(estimates.scene_id == scene).tolist()
        }
        (folder / "scene_gt.json").write_text(json.dumps(images))
    for name, table in tables().items():
        write_results(root / f"{name}_made-test.csv", table)
    keys = {
        "dataset": ["made"] * N,
        "scene_id": estimates.scene_id,
        "im_id": estimates.im_id,
        "obj_id": estimates.obj_id,
    }
    outcomes = [
        pl.DataFrame(keys | {"success": held.astype(int)}).with_columns(
            estimator=pl.lit(name), gripper=pl.lit("parallel")
        )
        for name, held in zip(estimates.estimators, given.success, strict=True)
    ]
    pl.concat(outcomes).write_csv(root / "outcomes.csv")
    pl.concat(outcomes).filter(obj_id=1).write_csv(root / "first.csv")
    trials = synthetic.error_outcomes(300, "made-2")
    errors = zip(ERROR_COLUMNS, error_numbers(trials.obj_T_est).T, strict=True)
    columns = {
        "estimator": ["transferred"] * 300,
        "dataset": ["made"] * 300,
        "scene_id": [0] * 300,
        "im_id": list(range(300)),
        "obj_id": [2] * 300,
        "gripper": ["parallel"] * 300,
        "success": trials.success.astype(int),
    }
    (root / "campaign").mkdir()
    pl.DataFrame(columns | dict(errors)).write_parquet(root / "campaign" / "outcomes.parquet")
    with_outcomes = ["--outcomes", str(root / "outcomes.csv")]
    assert main(train(root, "abc.npz", *with_outcomes)) == 0
    assert main(train(root, "ab.npz", *with_outcomes, names="ab")) == 0
    assert main(train(root, "simulated.npz", "--simulated", str(root / "campaign"))) == 0


def inputs(world: Path, names: str = "abc", folder: Path | None = None) -> list[str]:
    out = ["--bop", str(world / "made")]
    for name in names:
        out += ["--estimates", f"{name}={(folder or world) / f'{name}_made-test.csv'}"]
    return out


def train(world: Path, out: str, *more: str, names: str = "abc") -> list[str]:
    start = ["train", *inputs(world, names), "--principal", "a", "--gripper", "parallel"]
    folds = [] if "--folds" in more or "--outcomes" not in more else ["--folds", "0"]
    return [*start, "--trees", "6", "--out", str(world / out), *folds, *more]


def predict(
    world: Path,
    out: Path,
    *more: str,
    models: tuple[str, ...] = ("abc.npz",),
    names: str = "abc",
    folder: Path | None = None,
) -> list[str]:
    start = ["predict", *inputs(world, names, folder), "--out", str(out / "v.csv")]
    return [*start, *(t for m in models for t in ("--model", str(world / m))), *more]


def verdicts(out: Path) -> list[dict[str, str]]:
    with (out / "v.csv").open() as stream:
        return list(csv.DictReader(stream))
