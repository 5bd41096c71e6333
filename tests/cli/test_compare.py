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
