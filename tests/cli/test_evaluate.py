"""``graspcast evaluate`` from end to end, and how it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from graspcast.cli import main
from graspcast.paper.dataset import ESTIMATORS, GRIPPERS


@pytest.mark.slow
def test_from_the_data_to_the_json(
    data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["evaluate", "--data", str(data_dir), "--methods", "majority", "--seed", "4"]
    command += ["--protocols", "random_split", "unseen_object", "--bootstrap", "50"]
    command += ["--failure-cost", "1", "--abstain-cost", "0", "--work", str(tmp_path / "work")]
    texts = []
    for name in ("one.json", "two.json"):  # the second time nothing is computed again
        assert main([*command, "--json", str(tmp_path / name)]) == 0
        texts.append(capsys.readouterr().out)
    assert texts[0] == texts[1]
    assert "## `unseen_object`\n\nEach object left out in turn" in texts[0]
    one, two = (json.loads((tmp_path / n).read_text()) for n in ("one.json", "two.json"))
    assert one["evaluate"] == two["evaluate"]
    for protocol in ("random_split", "unseen_object"):
        for gripper in GRIPPERS:
            figures = one["evaluate"][protocol]["majority"][gripper]
            for measure in ("accuracy", "auroc", "brier", "ece", "aurc"):
                assert isinstance(figures[measure], float)
            assert tuple(figures["by_principal"]) == ESTIMATORS
    accuracy = [one["evaluate"]["random_split"]["majority"][g]["accuracy"] for g in GRIPPERS]
    assert accuracy == pytest.approx([0.755, 0.808], abs=1e-3)
    assert one["costs"] == {"failure": 1.0, "abstention": 0.0, "break_even": 0.5}
    assert one["seed"] == one["bootstrap"]["seed"] == 4
    assert one["settings"] == {"majority": "Majority(seed=4)"}
    assert one["protocols"].keys() == one["evaluate"].keys()
    assert {"graspcast", "numpy", "scikit-learn"} <= one["versions"].keys()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--methods", "tresholt"], "unknown method 'tresholt' (did you mean 'threshold'?)"),
        (["--protocols", "unseen"], "unknown protocol 'unseen'"),
        (["--failure-cost", "-1"], "the cost of a failure should be 0 or more"),
        (["--protocols", "random_split", "--figures", "f"], "add it to --protocols"),
        (["--methods", "MLP", "--draw", "MLP-O"], "unknown method to draw 'MLP-O'"),
        ([], "no published/lmo/trials.csv here"),
    ],
)
def test_refusals(
    more: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "out.json"
    assert main(["evaluate", "--data", str(tmp_path), "--json", str(target), *more]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_own_outcomes_are_asked_for(data_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["evaluate", "--data", str(data_dir), "--methods", "majority"]
    assert main([*command, "--protocols", "unseen_object_simulated"]) == 2
    assert "give its directory (see --outcomes)" in capsys.readouterr().err


@pytest.mark.slow
def test_own_outcomes_that_are_the_published_ones_give_the_same_table(
    data_dir: Path, tmp_path: Path
) -> None:
    target = tmp_path / "out.json"
    command = ["evaluate", "--data", str(data_dir), "--methods", "majority", "--bootstrap", "20"]
    command += ["--protocols", "unseen_object", "unseen_object_simulated", "--json", str(target)]
    for dataset in ("lmo", "ycbv"):
        command += ["--outcomes", str(data_dir / "published" / dataset / "trials.csv")]
    assert main(command) == 0
    found = json.loads(target.read_text())["evaluate"]
    assert found["unseen_object"] == found["unseen_object_simulated"]
