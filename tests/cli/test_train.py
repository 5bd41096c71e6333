"""The verb train."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import polars as pl
import pytest

import forest_commands as forests
from commands import refused
from graspcast.cli import main
from network_commands import predict, train


@pytest.mark.parametrize("method", ["threshold", "MLP"])
def test_the_other_methods(world: Path, method: str) -> None:
    assert main(train(world, "--folds", "0", "--method", method)) == 0
    assert main(predict(world)) == 0


@pytest.mark.parametrize("method", [pytest.param("direct", marks=pytest.mark.slow), "MLP"])
def test_the_order_of_the_estimates_changes_no_byte_of_the_model(world: Path, method: str) -> None:
    files = []
    for names in ("abc", "cab", "bca"):
        assert main(train(world, "--folds", "2", "--method", method, names=names)) == 0
        files.append((world / "m.npz").read_bytes())
    assert files[0] == files[1] == files[2]


def test_unknown_names_are_answered_with_the_known(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused([*train(world), "--principal", "d"], capsys)
    assert "unknown estimator 'd'; known: a, b, c" in said
    said = refused([*train(world), "--gripper", "paralel"], capsys)
    assert "'paralel' (did you mean 'parallel'?); known: parallel" in said
    assert not (world / "m.npz").exists()


def test_too_little_to_learn_from(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = pl.read_csv(world / "outcomes.csv")
    table.with_columns(success=pl.lit(1)).write_csv(world / "outcomes.csv")
    said = refused(train(world, "--folds", "0"), capsys)
    assert "60 outcomes of a with 60 successes are too few" in said
    table.filter(pl.col("im_id") > 1000).write_csv(world / "outcomes.csv")
    refused(train(world, "--folds", "0"), capsys)


@pytest.mark.slow
def test_simulated_trials_beside_outcomes_of_another_object(
    trained: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = ["--outcomes", str(trained / "first.csv"), "--simulated", str(trained / "campaign")]
    assert main(forests.train(trained, "both.npz", *more)) == 0
    assert "2 objects (1 by simulation alone), 60 samples" in capsys.readouterr().out
    assert main(forests.train(trained, "alone.npz", "--simulated", more[-1])) == 0
    assert capsys.readouterr().out.endswith("1 object (1 by simulation alone)\n")


def test_nothing_to_learn_from(trained: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(forests.train(trained, "none.npz"), capsys)
    assert "neither outcomes nor simulated trials" in said
    assert "(see --outcomes, --simulated)" in said
    other = forests.train(
        trained, "none.npz", "--simulated", str(trained / "campaign"), "--gripper", "hand"
    )
    assert "no simulated trial of the hand gripper" in refused(other, capsys)
    without = forests.train(trained, "none.npz", "--simulated", str(trained / "outcomes.csv"))
    assert "no column 'error_x_m'" in refused(without, capsys)
    assert not (trained / "none.npz").exists()


@pytest.mark.parametrize("method", ["blend", pytest.param("two-stage", marks=pytest.mark.slow)])
def test_a_method_that_needs_ground_truth_is_refused_without_it(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], method: str
) -> None:
    outcomes = ["--outcomes", str(trained / "outcomes.csv")]
    command = [*forests.train(trained, "none.npz", *outcomes), "--method", method]
    bare = tmp_path / "made"
    shutil.copytree(trained / "made" / "models", bare / "models")
    command[command.index("--bop") + 1] = str(bare)
    said = refused(command, capsys)
    assert "the methods blend and two-stage need ground truth" in said
    assert "choose the method direct" in said
    assert "(see --ground-truth, --bop, --method)" in said
    assert not (trained / "none.npz").exists()
    elsewhere = tmp_path / "elsewhere" / "000000"
    elsewhere.mkdir(parents=True)
    (elsewhere / "scene_gt.json").write_text(
        json.dumps(
            {
                "9999": [
                    {
                        "obj_id": 1,
                        "cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1],
                        "cam_t_m2c": [0, 0, 900],
                    }
                ]
            }
        )
    )
    said = refused([*command, "--ground-truth", str(elsewhere.parent)], capsys)
    assert "none of the instances has a known true pose" in said
    assert main([*command, "--method", "direct", "--out", str(tmp_path / "direct.npz")]) == 0
