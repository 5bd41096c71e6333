"""The verb simulate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from commands import refused
from cubes import OBJECTS
from graspcast.cli import main
from graspcast.simulation.grasps.table import ReferenceGrasp, write_grasps
from graspcast.simulation.objects.types import Grasp
from network_commands import inputs


@pytest.fixture
def tables(world: Path) -> list[str]:
    """A catalogue and a grasp table in which object made-1 is a cube."""
    import trimesh

    trimesh.creation.box(extents=(60, 60, 60)).export(world / "cube.ply")
    text = OBJECTS.replace("objects.cube", "objects.made-1")
    (world / "objects.toml").write_text(text, encoding="utf-8")
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.015
    reference = ReferenceGrasp(Grasp(pose, "made-1", "parallel"), "by a test")
    write_grasps(world / "grasps.toml", [reference])
    return [
        *("--catalogue", str(world / "objects.toml")),
        *("--grasps", str(world / "grasps.toml")),
    ]


def simulate(world: Path, *more: str) -> list[str]:
    out = ["--out", str(world / "campaign"), "--workers", "1"]
    return ["simulate", *inputs(world, "a"), "--gripper", "parallel", *out, *more]


def test_a_trial_for_each_estimate_and_none_twice(
    world: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    command = simulate(world, *tables, "--scenes", "0")
    assert main(command) == 0
    out = capsys.readouterr().out
    assert "made-1" in out and "parallel" in out and "campaign: 10 trials" in out
    files = {path: path.stat().st_mtime_ns for path in (world / "campaign").rglob("*.parquet")}
    outcomes = pl.concat([pl.read_parquet(path) for path in files], how="diagonal")
    assert set(outcomes["estimator"]) == {"a"} and set(outcomes["im_id"]) == set(range(0, 60, 6))
    assert main(command) == 0
    assert {path: path.stat().st_mtime_ns for path in files} == files


def test_what_cannot_be_simulated_is_refused(
    world: Path, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert "unknown gripper 'claw'" in refused(simulate(world, "--gripper", "claw"), capsys)
    assert "made-1" in refused(simulate(world), capsys)
    said = refused(simulate(world, "--lenient"), capsys)
    assert "no estimate has both a ground truth and a reference grasp" in said
    assert not (world / "campaign").exists()
