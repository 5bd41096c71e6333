"""Files of a run, recognised."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import graspcast.report.run_files as run_files
from graspcast.errors import InputError
from graspcast.report.run_files import RunFiles, find_run
from small_run import write_run


def test_files_are_told_by_what_they_hold(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    (run / "commands.sh").write_text("graspcast predict\n")
    (run / "notes.txt").write_text("notes")
    (run / ".hidden.csv").write_text("success\n")
    (run / "odd.csv").write_text("a,b\n1,2\n")
    (run / "tolerance.json").write_text('{"object": "d-1", "gripper": "g", "at_true_pose": {}}')
    (run / "certificate.json").write_text('{"format": 3, "guarantees": [], "sha256": "0"}')
    np.savez(run / "model.npz", card=np.array("{}"))
    np.savez(run / "other.npz", weights=np.zeros(3))
    trials = run / "deep" / "trials"
    trials.mkdir(parents=True)
    (trials / "manifest.json").write_text("{}")
    (run / "data" / "models").mkdir(parents=True)
    found = find_run(run)
    assert found.name == "run" and found.directory == run
    assert [p.name for p in found.verdicts] == ["verdicts1.csv", "verdicts2.csv"]
    assert [p.name for p in found.outcomes] == ["trials", "outcomes1.csv", "outcomes2.csv"]
    assert dict(found.estimates).keys() == {"a", "fused2"}
    assert [p.name for p in found.models] == ["model.npz"]
    assert [p.name for p in found.certificates] == ["certificate.json"]
    assert [p.name for p in found.tolerances] == ["tolerance.json"]
    assert found.bop == ((None, run / "data"),)
    assert found.commands == run / "commands.sh"
    assert found.shown(run / "deep" / "trials") == "deep/trials"
    assert found.shown("/elsewhere/x.csv") == "x.csv"


def test_names_count_numbers(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", looks=1)
    (run / "verdicts10.csv").write_bytes((run / "verdicts1.csv").read_bytes())
    (run / "verdicts9.csv").write_bytes((run / "verdicts1.csv").read_bytes())
    names = [p.name for p in find_run(run).verdicts]
    assert names == ["verdicts1.csv", "verdicts9.csv", "verdicts10.csv"]


def test_what_is_given_replaces_its_kind(tmp_path: Path) -> None:
    found = find_run(write_run(tmp_path / "run"))
    given = RunFiles("given", verdicts=(tmp_path / "mine.csv",), bop=(("d", tmp_path),))
    both = found.with_given(given)
    assert both.verdicts == (tmp_path / "mine.csv",) and both.bop == (("d", tmp_path),)
    assert both.outcomes == found.outcomes and both.name == "run"


def test_what_is_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="no such directory"):
        find_run(tmp_path / "nowhere")
    (tmp_path / "file.csv").write_text("a\n")
    with pytest.raises(InputError, match="is a file; a run is a directory"):
        find_run(tmp_path / "file.csv")
    with pytest.raises(InputError, match="holds nothing that a report shows"):
        find_run(tmp_path)
    monkeypatch.setattr(run_files, "MOST_FILES", 3)
    for number in range(5):
        (tmp_path / f"{number}.json").write_text(json.dumps({}))
    with pytest.raises(InputError, match="more than 3 files; is it a run's directory"):
        find_run(tmp_path)


def test_a_loop_of_links_ends(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", looks=1)
    (run / "again").symlink_to(run)
    assert len(find_run(run).verdicts) == 1
