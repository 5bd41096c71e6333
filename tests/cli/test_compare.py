"""The verb compare, on small files of a dataset "made"."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import refused
from graspcast.bop.results import write_results
from graspcast.cli import main
from graspcast.evaluation.paired_differences import FORECAST_MEASURES, PRINCIPAL_MEASURES
from looked_at import CAMERAS, SCENES, training
from poses import results_of, write_models
from supporters import EstimatorWorld


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    world = EstimatorWorld.make(72, scenes=6)
    write_models(tmp_path / "made" / "models", obj_1={}, obj_2={})
    for name, poses in world.poses.items():
        table = results_of(poses)
        table = dataclasses.replace(table, scene_id=world.scene, obj_id=1 + np.arange(72) % 2)
        write_results(tmp_path / f"{name}_made-test.csv", table)
    world.outcomes.write_csv(tmp_path / "outcomes.csv")
    return tmp_path


def arguments(folder: Path, *more: str, names: str = "abc", gripper: str = "parallel") -> list[str]:
    out = ["compare", "--bop", str(folder / "made"), "--gripper", gripper]
    for name in names:
        out += ["--estimates", f"{name}={folder / f'{name}_made-test.csv'}"]
    out += ["--outcomes", str(folder / "outcomes.csv"), "--trees", "4", "--folds", "2"]
    return [*out, "--bootstrap", "20", "--method", "direct", *more]


@pytest.mark.slow
def test_the_verb_prints_what_it_writes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = folder / "compare.json"
    assert main(arguments(folder, "--json", str(path))) == 0
    out, err = capsys.readouterr()
    assert "no instance has an outcome of c" in err
    figures = json.loads(path.read_text())["compare"]
    keys = ["gripper", "estimators", "principals", "common", "settings", "recommendation"]
    assert list(figures) == keys
    assert set(figures["principals"]) == {"a", "b"}
    principal = figures["principals"]["a"]
    assert set(principal) == {
        "n", "without_forecast", "scenes", "success_rate", "scores", "without", "alone",
    }  # fmt: skip
    assert set(principal["scores"]) == set(FORECAST_MEASURES)
    gain = principal["without"]["b"]["improvement"]["aurc"]
    assert set(gain) == {"value", "low", "high"}
    assert f"{gain['value']:+.3f} [{gain['low']:+.3f}, {gain['high']:+.3f}]" in out
    assert f"{principal['success_rate']:.3f} if all are attempted" in out
    assert figures["common"]["n"] == 72
    assert set(figures["common"]["improvement"]["a"]["b"]) == set(PRINCIPAL_MEASURES)
    assert figures["recommendation"] in out
    assert figures["settings"]["forests"]["trees"] == 4


@pytest.mark.slow
def test_of_two_estimators_one_is_the_only_supporter(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments(folder, names="ab")) == 0
    out, _ = capsys.readouterr()
    assert "is its only supporter, without which there is no forecast" in out
    assert "without a" not in out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"names": "a"}, "a consensus takes at least two estimators"),
        ({"gripper": "vacuum"}, "unknown gripper 'vacuum'; known: parallel. These have"),
        ({"names": "bc", "more": ["--folds", "1"]}, "two folds"),
        ({"more": ["--folds", "9"]}, "6 scenes cannot make 9 folds"),
    ],
)
def test_mistakes_are_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], options: dict[str, Any], message: str
) -> None:
    path = folder / "never.json"
    more = [*options.pop("more", []), "--json", str(path)]
    assert main(arguments(folder, *more, **options)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert not path.exists()
    last = err.strip().splitlines()[-1]
    assert last.startswith("graspcast compare: ")
    assert re.search(message, last), last


def test_the_default_method_needs_ground_truth(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(arguments(folder, "--method", "blend"), capsys)
    assert "need ground truth" in said
    assert "(see --ground-truth, --bop, --method)" in said


# --- Several views --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def static(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two objects in twelve static scenes, seen by a and b; grasps by a were tried."""
    root = tmp_path_factory.mktemp("static")
    given = training(root / "d" / "models", names=("a", "b"))
    for name, table in given.results.items():
        write_results(root / f"{name}_d-test.csv", table)
    keys = given.data.estimates
    lines = ["estimator,dataset,scene_id,im_id,obj_id,gripper,success"]
    truth: dict[int, dict[int, list[dict[str, Any]]]] = {s: {} for s in range(1, SCENES + 1)}
    for i, success in enumerate(given.data.own_success.astype(int).tolist()):
        where = int(keys.scene_id[i]), int(keys.im_id[i]), int(keys.obj_id[i])
        lines.append(f"a,d,{where[0]},{where[1]},{where[2]},parallel,{success}")
        pose = given.data.truth[i]
        true = {"obj_id": where[2], "cam_R_m2c": pose[:3, :3].ravel().tolist()}
        true["cam_t_m2c"] = (1000 * pose[:3, 3]).tolist()
        truth[where[0]].setdefault(where[1], []).append(true)
    (root / "outcomes.csv").write_text("\n".join(lines) + "\n")
    for scene, poses in truth.items():
        folder = root / "truth" / f"{scene:06d}"
        folder.mkdir(parents=True)
        (folder / "scene_gt.json").write_text(json.dumps(poses))
    rows = ["scene_id,im_id,world_T_cam_m"]
    for scene in truth:
        rows += [
            f"{scene},{image},{' '.join(map(str, pose.ravel().tolist()))}"
            for image, pose in enumerate(CAMERAS)
        ]
    (root / "cameras.csv").write_text("\n".join(rows) + "\n")
    return root


def of_views(root: Path, *more: str) -> list[str]:
    out = ["compare", "--bop", str(root / "d"), "--gripper", "parallel"]
    for name in "ab":
        out += ["--estimates", f"{name}={root / f'{name}_d-test.csv'}"]
    out += ["--outcomes", str(root / "outcomes.csv"), "--ground-truth", str(root / "truth")]
    return [*out, "--trees", "4", "--folds", "2", "--bootstrap", "50", *more]


@pytest.mark.slow
def test_a_second_view_beside_a_second_estimator(
    static: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    plain, seen = tmp_path / "plain.json", tmp_path / "seen.json"
    assert main(of_views(static, "--json", str(plain))) == 0
    before, _ = capsys.readouterr()
    poses = ["--camera-poses", str(static / "cameras.csv")]
    assert main(of_views(static, *poses, "--json", str(seen))) == 0
    out, _ = capsys.readouterr()
    # What was said without views is said with them, and more.
    assert before.splitlines()[:5] == out.splitlines()[:5]
    said, more = (json.loads(p.read_text())["compare"] for p in (plain, seen))
    assert "views" not in said and "a second view" not in said["recommendation"]
    assert {k: said[k] for k in said if k != "recommendation"} == {
        k: more[k] for k in said if k != "recommendation"
    }
    worth = more["views"]["a"]
    assert worth["n"] == 2 * SCENES * len(CAMERAS) and worth["without_views"] == 0
    kinds = {(" ".join(f["estimators"]), f["views"]) for f in worth["forecasts"]}
    assert kinds == {("a b", 1), ("a b", 2), ("a b", 3), ("a", 2), ("a", 3)}
    gain = worth["instead"]["2"]
    assert gain["better"] == {"estimators": ["a"], "views": 2}
    assert gain["worse"] == {"estimators": ["a", "b"], "views": 1}
    # Both err along the ray, by as much as decides; a second view sees that, a second estimator
    # does not.
    aurc = gain["improvement"]["aurc"]
    assert aurc["low"] > 0
    told = f"{aurc['value']:+.3f} [{aurc['low']:+.3f}, {aurc['high']:+.3f}]"
    assert f"a second view is worth more than a second estimator (b): {told}" in out
    cells = [[c.strip() for c in line.split("│")] for line in out.splitlines() if "│" in line]
    (row,) = (c for c in cells if c[1:3] == ["a alone, 2 views", "all, 1 view"])
    assert row[3] == told
    scores = {(" ".join(f["estimators"]), f["views"]): f["scores"] for f in worth["forecasts"]}
    (row,) = (c for c in cells if c[1] == "a alone, 3 views" and len(c) > 7)
    assert row[2] == f"{scores['a', 3]['aurc']:.3f}"


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--max-views", "1"], "nothing to compare"),
        (["--method", "direct"], "the method direct does not forecast with several views"),
        pytest.param(
            ["--max-views", "6"],
            "no instance of a with forecasts has 6 views",
            marks=pytest.mark.slow,
        ),
        (["--min-parallax", "179"], "no training instance has a pose from several views"),
    ],
)
def test_views_that_cannot_be_compared(
    static: Path, capsys: pytest.CaptureFixture[str], more: list[str], message: str
) -> None:
    poses = ["--camera-poses", str(static / "cameras.csv")]
    assert message in refused(of_views(static, *poses, *more), capsys)
