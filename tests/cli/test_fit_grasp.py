"""The verb fit-grasp."""

from __future__ import annotations

from pathlib import Path

import pytest

from commands import refused
from network_commands import inputs

PAIR = ["fit-grasp", "--object", "made-1", "--gripper", "parallel"]


def test_trials_come_from_published_data_or_from_files(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(world / "grasps.toml")]
    said = refused([*PAIR, *inputs(world, "a"), *out], capsys)
    assert "give --data, or else --estimates, --bop and --outcomes" in said
    said = refused([*PAIR, "--data", str(world), *out], capsys)
    assert "no published/lmo/trials.csv here" in said


def test_grippers_and_objects_that_are_not_known(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [*inputs(world, "a"), "--outcomes", str(world / "outcomes.csv")]
    given += ["--out", str(world / "grasps.toml")]
    said = refused(["fit-grasp", "--object", "made-1", "--gripper", "claw", *given], capsys)
    assert "unknown gripper 'claw'" in said
    assert "made-1" in refused([*PAIR, *given], capsys)
    assert not (world / "grasps.toml").exists()
