"""The benchmark of what guides a grasp: rates and differences on the same instances."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import polars as pl
import pytest

from graspcast.bop.results import Results, write_results
from graspcast.demo_data import demo_dataset
from graspcast.evaluation.bootstrap import Bootstrap
from static_scenes import scattered


@pytest.fixture(scope="module")
def guides() -> ModuleType:
    sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
    import guides

    return guides


def estimates(path: Path, seed: int) -> Path:
    """Estimates of one object on two tables, wrong by some centimetres along the ray."""
    truth = demo_dataset().ground_truth
    obj_id = int(truth.obj_id[truth.scene_id == 1][0])
    scenes = [
        s for s in np.unique(truth.scene_id) if (truth.obj_id[truth.scene_id == s] == obj_id).any()
    ]
    rows = np.flatnonzero(np.isin(truth.scene_id, scenes[:2]) & (truth.obj_id == obj_id))[::2]
    results = Results(
        scene_id=truth.scene_id[rows],
        im_id=truth.im_id[rows],
        obj_id=truth.obj_id[rows],
        score=np.ones(len(rows)),
        cam_T_obj=scattered(truth.cam_T_obj[rows], seed, (0.001, 0.05, 0.03)),
        time_s=np.full(len(rows), -1.0),
        line=np.arange(len(rows)) + 2,
    )
    write_results(path, results)
    return path


@pytest.mark.slow
def test_fused_poses_guide_better_than_one_view(guides: ModuleType, tmp_path: Path) -> None:
    root = demo_dataset().root
    out, page = tmp_path / "guides.json", tmp_path / "guides.md"
    arguments = ["--estimates", f"one={estimates(tmp_path / 'one_ycbv-test.csv', 0)}"]
    arguments += ["--estimates", f"two={estimates(tmp_path / 'two_ycbv-test.csv', 1)}"]
    arguments += ["--bop", str(root), "--camera-poses", str(root / "test")]
    arguments += ["--gripper", "parallel", "--views", "3", "--noise-mm", "1"]
    arguments += ["--work", str(tmp_path / "work"), "--json", str(out), "--markdown", str(page)]
    guides.main(arguments)
    cell = json.loads(out.read_text())["ycbv"]["parallel"]
    rates = {name: mine["success"] for name, mine in cell["guides"].items()}
    assert list(rates) == [
        "one, one view",
        "all, 3 views",
        "one alone, 3 views",
        "all, 3 views, motion known to 1 mm, 0.1°",
        "all, 3 views, earlier images",
        "two, one view",
        "true pose",
    ]
    assert rates["all, 3 views"] > rates["one, one view"] + 0.2
    assert cell["guides"]["one, one view"]["difference"] == 0
    gain = cell["guides"]["all, 3 views"]["difference"]
    assert gain == pytest.approx(rates["all, 3 views"] - rates["one, one view"])
    assert f"parallel (n {cell['n']})" in page.read_text()

    shards = sorted((tmp_path / "work").rglob("*.parquet"))
    first = out.read_bytes()
    guides.main(arguments)
    assert out.read_bytes() == first
    assert sorted((tmp_path / "work").rglob("*.parquet")) == shards


def test_differences_are_paired_over_scenes(guides: ModuleType) -> None:
    n = 40
    outcomes = pl.DataFrame(
        {
            "dataset": ["ycbv"] * n,
            "scene_id": np.repeat([1, 2, 3, 4], 10),
            "im_id": np.arange(n),
            "obj_id": [2] * n,
            "est_id": [0] * n,
            "one": [1, 0] * (n // 2),
            "same": [1, 0] * (n // 2),
            "right": [1] * n,
        }
    )
    found = guides.compared(outcomes, ["one", "same", "right"], Bootstrap(draws=200))
    assert (found["n"], found["scenes"]) == (n, 4)
    assert found["guides"]["same"]["difference_interval"] == [0.0, 0.0]
    assert found["guides"]["right"]["success"] == 1.0
    assert found["guides"]["right"]["difference_interval"] == [0.5, 0.5]
    assert found["guides"]["one"]["objects"] == {"ycbv-2": 0.5}
