"""The verb fit-grasp."""

from __future__ import annotations

from pathlib import Path

import pytest

from commands import refused
from cubes import OBJECTS
from graspcast.cli import main
from graspcast.simulation.trial.settings import TrialSettings
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


class StoppedError(Exception):
    """What a search raises that should only begin."""


@pytest.fixture
def protocols(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The protocols of the searches that were begun."""
    seen: list[str] = []

    def begin(*_: object, settings: TrialSettings, **__: object) -> None:
        seen.append(settings.protocol)
        raise StoppedError

    monkeypatch.setattr("graspcast.simulation.grasps.search.fit_grasp", begin)
    return seen


def test_outcomes_of_one_s_own_are_of_the_robot_s_protocol(
    world: Path, protocols: list[str]
) -> None:
    import trimesh

    trimesh.creation.box(extents=(60, 60, 60)).export(world / "cube.ply")
    catalogue = world / "objects.toml"
    catalogue.write_text(OBJECTS.replace("objects.cube", "objects.made-1"), encoding="utf-8")
    given = [*inputs(world, "a"), "--outcomes", str(world / "outcomes.csv")]
    given += ["--catalogue", str(catalogue), "--out", str(world / "grasps.toml")]
    with pytest.raises(StoppedError):
        main([*PAIR, *given])
    assert protocols == ["robot"]


@pytest.mark.slow
def test_published_outcomes_are_of_the_paper_s_protocol(
    data_dir: Path, tmp_path: Path, protocols: list[str]
) -> None:
    pair = ["fit-grasp", "--object", "ycbv-5", "--gripper", "parallel"]
    with pytest.raises(StoppedError):
        main([*pair, "--data", str(data_dir), "--out", str(tmp_path / "grasps.toml")])
    assert protocols == ["paper"]


def test_grippers_and_objects_that_are_not_known(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [*inputs(world, "a"), "--outcomes", str(world / "outcomes.csv")]
    given += ["--out", str(world / "grasps.toml")]
    said = refused(["fit-grasp", "--object", "made-1", "--gripper", "claw", *given], capsys)
    assert "unknown gripper 'claw'" in said
    assert "made-1" in refused([*PAIR, *given], capsys)
    assert not (world / "grasps.toml").exists()
