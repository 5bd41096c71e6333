"""The files of a run, read."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from graspcast.errors import FormatError, InputError
from graspcast.report.run_data import read_run
from graspcast.report.run_files import find_run
from report.test_tolerances import CONTENT
from small_run import outcomes, verdicts, write_run


def test_all_that_is_there_is_read(tmp_path: Path) -> None:
    directory = write_run(tmp_path / "run")
    (directory / "tolerance.json").write_text(json.dumps(CONTENT))
    (directory / "commands.sh").write_text("graspcast predict\n")
    found = read_run(find_run(directory))
    assert found.has_outcomes and found.problems == () and found.commands == "graspcast predict\n"
    assert set(found.results["d"]) == {"a", "fused2"} and not found.datasets
    assert list(found.tolerances.values()) == [CONTENT]


@pytest.mark.slow
def test_damaged_files_are_said_not_passed_over(tmp_path: Path) -> None:
    directory = write_run(tmp_path / "run")
    outcomes(verdicts(1, looks=1)).write_parquet(tmp_path / "whole.parquet")
    whole = (tmp_path / "whole.parquet").read_bytes()
    (directory / "cut.parquet").write_bytes(whole[: len(whole) // 2])
    (directory / "empty.parquet").write_bytes(b"")
    (directory / "cut.npz").write_bytes(b"PK\x03\x04")
    found = read_run(find_run(directory))
    said = " ".join(found.problems)
    assert found.has_outcomes
    assert all(f"left out, {directory / name}" in said for name in ("cut.parquet", "cut.npz"))
    assert "empty.parquet" in said


def test_what_is_recognised_and_wrong_is_left_out_and_said(tmp_path: Path) -> None:
    directory = write_run(tmp_path / "run")
    (directory / "certificate.json").write_text('{"guarantees": [], "sha256": "0"}')
    (directory / "tolerance.json").write_text('{"at_true_pose": 1, "gripper": "g"}')
    (directory / "more.csv").write_text("estimator,success\na,7\n")
    (directory / "commands.sh").write_bytes(b"\xff\x00")
    files = find_run(directory)
    found = read_run(files)
    assert found.has_outcomes and not found.certificates and not found.tolerances
    said = " ".join(found.problems)
    assert "certificate.json" in said and "is no tolerance" in said and "more.csv" in said
    assert "commands.sh" in said and found.commands == ""
    # What was named is an error.
    for kind in ("certificates", "tolerances", "outcomes"):
        with pytest.raises(FormatError):
            read_run(files, given=[kind])


def test_tolerances_that_are_no_sizes(tmp_path: Path) -> None:
    directory = write_run(tmp_path / "run", looks=1)
    for bad in (float("nan"), -1.0, "x"):
        reach = {**CONTENT["reaches"][0], "success_90": {"value": bad, "low": 0, "high": 1}}
        content = {**CONTENT, "reaches": [reach, *CONTENT["reaches"][1:]]}
        (directory / "tolerance.json").write_text(json.dumps(content))
        found = read_run(find_run(directory))
        assert not found.tolerances and "is no complete tolerance" in found.problems[0]


def test_of_long_commands_the_beginning_is_kept(tmp_path: Path) -> None:
    directory = write_run(tmp_path / "run", looks=1)
    (directory / "commands.sh").write_text("x" * 30_000)
    assert len(read_run(find_run(directory)).commands) < 21_000


def test_outcomes_of_other_grasps(tmp_path: Path) -> None:
    directory = write_run(tmp_path / "run", looks=1)
    outcomes(verdicts(1, dataset="e")).write_csv(directory / "outcomes1.csv")
    found = read_run(find_run(directory))
    assert not found.has_outcomes
    assert "no outcome is of any of the verdicts, which are of a on d" in found.problems[0]
    with pytest.raises(InputError, match="are they of other images"):
        read_run(find_run(directory), given=["outcomes"])


def test_outcomes_alone_or_nothing(tmp_path: Path) -> None:
    directory = write_run(tmp_path / "run", looks=1)
    files = find_run(directory)
    alone = read_run(replace(files, verdicts=()))
    assert alone.decisions is None and not alone.has_outcomes and alone.trials
    with pytest.raises(InputError, match="there is nothing to report: there are neither"):
        read_run(replace(files, verdicts=(), outcomes=()))


def test_estimates_that_are_wrong_cost_the_pictures_alone(tmp_path: Path) -> None:
    directory = write_run(tmp_path / "run", looks=1)
    files = replace(find_run(directory), bop=((None, directory / "nowhere"),))
    found = read_run(files)
    assert found.has_outcomes and not found.results
    assert "left out the estimates and images" in found.problems[0]
    with pytest.raises(InputError, match="nowhere"):
        read_run(files, given=["bop"])
