"""The verb log, on logs that the test writes."""

from __future__ import annotations

import json
from pathlib import Path

import polars as pl
import pytest

from attempt_records import decision, frame, pose
from commands import refused
from graspcast.attempt_log import AttemptLog, OutcomeRecord
from graspcast.cli import log as verb
from graspcast.cli import main


@pytest.fixture
def log(tmp_path: Path) -> str:
    path = tmp_path / "log.db"
    with AttemptLog.open(path) as log:
        log.add([frame(i) for i in range(3)])
        log.add([frame(3, decision(3, action="abstain", object_name="ycbv-9", threshold=None))])
        log.add_outcome(OutcomeRecord("d0", True))
        log.add_outcome(OutcomeRecord("d2", False, "slipped \x1b[31m"))
    return str(path)


def test_it_shows_counts_and_the_last_rows(log, capsys) -> None:
    assert main(["log", log, "--last", "2"]) == 0
    out = capsys.readouterr().out
    assert "4 decisions, 3 attempts, 2 outcomes, 1 succeeded" in out
    assert "ycbv-9" in out
    assert "d1" not in out


@pytest.mark.parametrize(
    ("options", "count"),
    [
        (["--object", "ycbv-9"], 1),
        (["--object", "ycbv-9", "--object", "ycbv-5"], 4),
        (["--action", "attempt"], 3),
        (["--gripper", "none"], 0),
        (["--grasp", "reference"], 4),
        (["--model", "mmm"], 4),
        (["--with-outcome"], 2),
        (["--without-outcome"], 2),
        (["--since", "2026-03-01T12:00:00"], 4),
        (["--until", "2026-03-01T12:00:00+00:00"], 0),
    ],
)
def test_filters(log, tmp_path, options, count) -> None:
    assert main(["log", log, *options, "--json", str(tmp_path / "n.json")]) == 0
    assert json.loads((tmp_path / "n.json").read_text())["decisions"] == count


def test_names_that_the_log_does_not_have_are_said(log, capsys) -> None:
    assert main(["log", log, "--object", "ycbv-05", "--model", "zz"]) == 0
    said = capsys.readouterr().err
    assert "no decision of object ycbv-05; the log has: ycbv-5, ycbv-9" in said
    assert "no decision by a model zz; the log has: mmm" in said
    assert main(["log", log, "--object", "ycbv-9"]) == 0
    assert "no decision" not in capsys.readouterr().err


def test_an_export_of_no_known_kind_is_refused(log, tmp_path, capsys) -> None:
    assert refused(["log", log, "--out", str(tmp_path / "x.xlsx")], capsys).count(
        ".parquet or .csv"
    )
    assert not (tmp_path / "x.xlsx").exists()


def test_export(log, tmp_path) -> None:
    for name in ("x.parquet", "x.csv"):
        assert main(["log", log, "--out", str(tmp_path / name)]) == 0
    table = pl.read_parquet(tmp_path / "x.parquet")
    assert table["success"].to_list() == [True, None, False, None]
    assert table["cam_T_obj"][0].to_list() == pose().ravel().tolist()
    text = pl.read_csv(tmp_path / "x.csv")
    assert text["cam_T_obj"][0].split() == [repr(x) for x in pose().ravel().tolist()]
    assert text["time_utc"][0] == "2026-03-01T12:00:00.000000Z"
    assert text.columns == table.columns


def test_an_outcome_by_hand(log, capsys) -> None:
    add = ["log", log, "--add-outcome", "d1", "--success", "no", "--reason", "dropped"]
    assert main(add) == 0
    assert "3 outcomes, 1 succeeded" in capsys.readouterr().out
    assert main(add) == 0
    assert "was there already" in capsys.readouterr().err
    assert "already: it failed" in refused([*add[:-3], "yes"], capsys)
    assert "no decision 'd9'" in refused([*add[:3], "d9", "--success", "no"], capsys)
    assert "give both" in refused([*add[:4]], capsys)
    with AttemptLog.open(log):
        assert "another process writes to this log" in refused(add, capsys)


def test_copy_and_check(log, tmp_path, capsys) -> None:
    copy = str(tmp_path / "copy.db")
    assert main(["log", log, "--copy", copy, "--check"]) == 0
    assert main(["log", copy]) == 0
    assert "4 decisions" in capsys.readouterr().out
    assert "is read (FILE) and would be replaced" in refused(["log", log, "--copy", log], capsys)


def test_follow_prints_what_is_added(log, capsys, monkeypatch) -> None:
    def write_then_stop(seconds: float, calls: list[int] = []) -> None:  # noqa: B006
        calls.append(1)
        if len(calls) > 1:
            raise KeyboardInterrupt
        with AttemptLog.open(log) as writer:
            writer.add([frame(7)])
            writer.add_outcome(OutcomeRecord("d1", False, "dropped"))
            writer.add_outcome(OutcomeRecord("d7", True))

    monkeypatch.setattr(verb.time, "sleep", write_then_stop)
    assert main(["log", log, "--follow", "--object", "ycbv-5"]) == 130
    added = capsys.readouterr().out.partition("succeeded\n")[2].splitlines()
    assert added[0].split()[3:5] == ["d7", "ycbv-5"]
    assert added[1:] == ["d1 failed (dropped)", "d7 succeeded"]


def test_what_is_no_log(tmp_path, capsys) -> None:
    path = tmp_path / "no.db"
    assert "there is no attempt log" in refused(["log", str(path)], capsys)
    add = ["log", str(path), "--add-outcome", "d1", "--success", "no"]
    assert "there is no attempt log" in refused(add, capsys)
    assert not path.exists()
    path.write_text("estimator,dataset\n")
    assert "is no attempt log" in refused(["log", str(path)], capsys)
    assert "unknown action 'grab'" in refused(["log", str(path), "--action", "grab"], capsys)
