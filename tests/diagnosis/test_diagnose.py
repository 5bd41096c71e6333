"""The whole diagnosis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from graspcast import diagnose
from sick_files import healthy


def test_nothing_of_whole_files(tmp_path: Path) -> None:
    assert diagnose(healthy().write(tmp_path)) == []


def test_causes_come_before_their_consequences(tmp_path: Path) -> None:
    files = healthy()
    files.scores["a"] = 1.0
    files.estimates["b"] = {i: p.copy() for i, p in files.estimates["b"].items()}
    for poses in files.estimates["b"].values():
        poses[:, :3, :3] = np.swapaxes(poses[:, :3, :3], 1, 2)
    found = diagnose(files.write(tmp_path))
    assert [(f.severity, f.code) for f in found] == [
        ("error", "poses-transposed"),
        ("note", "scores-constant"),
    ]


def test_what_is_not_recognised(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("a,b\n")
    (finding,) = diagnose([tmp_path / "x.csv"])
    assert finding.code == "unrecognised"


def test_scenes_for_calibration(tmp_path: Path) -> None:
    table = pl.DataFrame(
        {
            "estimator": ["a"],
            "dataset": ["toy"],
            "scene_id": [1],
            "im_id": [1],
            "obj_id": [1],
            "gripper": ["parallel"],
            "success": [1],
        }
    )
    table.write_csv(tmp_path / "t.csv")
    table.write_csv(tmp_path / "c.csv")
    (finding,) = diagnose([tmp_path / "t.csv"], calibration=[tmp_path / "c.csv"])
    assert finding.code == "shared-images"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lmo", "ycbv"])
def test_no_error_on_published_data(name: str, data_dir: Path) -> None:
    found = diagnose([data_dir / "bop" / name, data_dir / "published" / name])
    assert {f.severity for f in found} <= {"note"}
    paths = [f.path for f in found]
    assert len(set(paths)) == len(paths)
