"""The verb errors."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

from commands import refused
from graspcast.bop.results import read_results, write_results
from graspcast.cli import main
from network_commands import N, inputs
from poses import ROW, write_csv


def test_errors_prints_a_table_and_writes_every_estimate(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["errors", *inputs(world, "ab"), "--json", str(world / "e.json")]
    assert main([*arguments, "--out", str(world / "e.parquet"), "--statistic", "mean"]) == 0
    out, _ = capsys.readouterr()
    assert "a on made, mean" in out
    assert "MSPD" in out
    table = pl.read_parquet(world / "e.parquet")
    assert len(table) == 2 * N
    figures = json.loads((world / "e.json").read_text())["errors"]["made"]["a"]
    mean = table.filter(pl.col("estimator") == "a")["translation_mm"].mean()
    assert figures[0]["translation_mm_mean"] == pytest.approx(mean)
    assert 0 < figures[0]["ray_share_mean"] < 1


def test_errors_have_a_shape(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["errors", *inputs(world, "ab"), "--json", str(world / "e.json"), "--shape"]
    assert main(arguments) == 0
    out, _ = capsys.readouterr()
    assert "rank correlation of errors on made" in out and "> 90°" in out
    shape = json.loads((world / "e.json").read_text())["shape"]["made"]
    assert set(shape["tails"]) == {"a", "b"}
    assert shape["tails"]["a"][-1]["n"] == shape["correlations"][0]["n"] == N


def test_metres_and_bad_rows_and_columns(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for row, says in (
        (ROW.replace("10 20 900", "0.01 0.02 0.9"), "in metres (0.90 m), not in millimetres"),
        (ROW.replace("1 0 0 0 1 0 0 0 1", "1 0 0 0 1 0 0 0 2"), "line 2: R is 1 away"),
        (ROW.replace("0.5", "nan"), "line 2: score is 'nan'"),
    ):
        write_csv(world / "a_made-test.csv", row)
        assert says in refused(["errors", *inputs(world, "a")], capsys)
    write_csv(world / "a_made-test.csv", ROW, header="scene_id,im_id,obj,score,R,t,time")
    assert "no column 'obj_id'" in refused(["errors", *inputs(world, "a")], capsys)


def test_estimates_of_another_convention_are_named(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = world / "a_made-test.csv"
    given = read_results(path)
    assert main(["errors", *inputs(world, "a")]) == 0
    assert "agree with ground truth when" not in capsys.readouterr().err
    turned = given.cam_T_obj.copy()
    turned[:, :3, :3] = np.swapaxes(turned[:, :3, :3], 1, 2)
    write_results(path, replace(given, cam_T_obj=turned))
    said = refused(["errors", *inputs(world, "a")], capsys)
    assert f"{N} of {N} poses in {path} agree with" in said
    assert "when their rotations are transposed" in said
    xyzw = Rotation.from_matrix(given.cam_T_obj[:, :3, :3]).as_quat()
    misread = given.cam_T_obj.copy()
    misread[:, :3, :3] = Rotation.from_quat(np.roll(xyzw, 1, axis=1)).as_matrix()
    write_results(path, replace(given, cam_T_obj=misread))
    said = refused(["errors", *inputs(world, "a")], capsys)
    assert "quaternion" in said
