"""The verb monitor, on attempt logs of a dataset "made"."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from attempt_records import certified, decision, frame
from commands import refused
from graspcast.attempt_log import AttemptLog, OutcomeRecord
from graspcast.cli import main
from graspcast.guarantees.certify import certify
from graspcast.guarantees.drift_monitor import DriftMonitor


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A success rate of 0.8, overall and for both objects."""
    n = np.arange(160)
    path = tmp_path_factory.mktemp("certificate") / "certificate.json"
    certify(
        np.full(160, 0.95),
        n % 20 > 0,
        n // 2,
        objects=np.array(["made-1", "made-2"])[n % 2],
        rate=0.8,
        confidence=0.9,
        provenance={"principal": "a", "gripper": "parallel", "unit": "scene"},
    ).save(path)
    return path


def monitor(certificate: Path, tmp_path: Path, log: Path, *more: str) -> list[str]:
    paths = ["--certificate", str(certificate), "--state", str(tmp_path / "s.json")]
    return ["monitor", *paths, "--attempt-log", str(log), *more]


def write_log(path: Path, success: list[bool], **change: object) -> Path:
    """Two attempts a scene, one object each."""
    n = np.arange(len(success))
    columns = {
        "estimator": "a",
        "dataset": "made",
        "scene_id": n // 2,
        "im_id": n,
        "obj_id": n % 2 + 1,
        "gripper": "parallel",
        "success": np.array(success, dtype=int),
    }
    pl.DataFrame({**columns, **change}).write_csv(path)
    return path


def test_a_log_that_grows_is_taken_in_once(
    certificate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, state = tmp_path / "log.csv", tmp_path / "s.json"
    success = [i % 7 > 0 for i in range(40)]
    arguments = monitor(certificate, tmp_path, write_log(log, success[:15]))
    assert main(arguments) == 0
    assert "no alarm. 15 new attempts, 15 in all" in capsys.readouterr().out
    once = state.read_bytes()
    assert main(arguments) == 0
    assert "0 new attempts, 15 in all" in capsys.readouterr().out
    assert state.read_bytes() == once
    write_log(log, success)
    assert main([*arguments, "--close-unit", "--json", str(tmp_path / "m.json")]) == 0
    straight = DriftMonitor(0.8)
    for i, held in enumerate(success):
        straight.observe(held, f"made/{i // 2}")
    straight.close_unit()
    assert json.loads((tmp_path / "m.json").read_text()) == json.loads(
        json.dumps(straight.as_dict())
    )


def test_an_alarm_is_exit_code_3_until_the_restart(
    certificate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_log(tmp_path / "log.csv", [False] * 30)
    arguments = monitor(certificate, tmp_path, log)
    assert main(arguments) == 3
    assert "ALARM since attempt" in capsys.readouterr().out
    write_log(log, [False] * 30 + [True] * 4)
    assert main(arguments) == 3
    assert "4 new attempts" in capsys.readouterr().out
    write_log(log, [False] * 30 + [True] * 6)
    assert main([*arguments, "--restart"]) == 0
    assert "no alarm. 2 new attempts, 2 in all" in capsys.readouterr().out


def test_the_guarantee_for_one_object_is_monitored_on_its_attempts(
    certificate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_log(tmp_path / "log.csv", [i % 2 == 0 for i in range(60)])  # made-2 always fails
    assert main(monitor(certificate, tmp_path, log, "--object", "made-1", "--close-unit")) == 0
    assert "made-1: no alarm. 30 new attempts" in capsys.readouterr().out
    (tmp_path / "s.json").unlink()
    assert main(monitor(certificate, tmp_path, log, "--object", "made-2", "--close-unit")) == 3


def test_what_the_monitor_refuses_changes_nothing(
    certificate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, state = tmp_path / "log.csv", tmp_path / "s.json"
    arguments = monitor(certificate, tmp_path, write_log(log, [True] * 10))
    assert main(arguments) == 0
    before = state.read_bytes()
    other = tmp_path / "other.json"
    other.write_text(certificate.read_text() + " ")
    for success, change, message in (
        ([True] * 9, {}, "does not begin with the 10 attempts"),
        ([False] + [True] * 11, {}, "does not begin with the 10 attempts"),
        ([True] * 12, {"gripper": "other"}, "attempts of gripper other"),
        ([True] * 12, {"estimator": "b"}, "the guarantee is for a"),
    ):
        write_log(log, success, **change)
        assert message in refused(arguments, capsys)
    write_log(log, [True] * 12)
    for more, message in (
        (["--alpha", "0.2"], "was made with alpha 0.05, not 0.2"),
        (["--max-attempts-per-unit", "4"], "was made with max_attempts_per_unit None"),
        (["--object", "made-1"], "the state of another guarantee (all objects)"),
        (["--object", "made-9"], "unknown scope of a guarantee 'made-9'"),
        (["--certificate", str(other)], "the state of another guarantee"),
        (["--certificate", str(tmp_path / "no.json")], "cannot be read"),
        (["--attempt-log", str(tmp_path / "no.csv")], "cannot be read"),
    ):
        assert message in refused([*arguments, *more], capsys)
    assert state.read_bytes() == before
    state.write_text(state.read_text()[:100])
    assert "not valid JSON" in refused(arguments, capsys)
    state.write_text("{}")
    assert "has no digest" in refused(arguments, capsys)


def test_a_certificate_without_a_threshold_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "none.json"
    n = np.arange(10)
    certify(np.full(10, 0.95), n > 5, n, rate=0.9, confidence=0.9).save(path)
    assert "guarantees nothing" in refused(monitor(path, tmp_path, tmp_path / "no.csv"), capsys)


def write_attempts(path: Path, numbers: range, rate: int) -> str:
    """Append episodes of one attempt each, of which one in ``rate`` succeeds."""
    with AttemptLog.open(path) as log:
        log.add([frame(i) for i in numbers])
        for i in numbers:
            log.add_outcome(OutcomeRecord(f"d{i}", i % rate == 0))
    return str(path)


def test_an_attempt_log_is_read_live(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stated = tmp_path / "certificate.json"
    certified(principal="epos", gripper="franka").save(stated)
    log, state = tmp_path / "log.db", tmp_path / "s.json"
    arguments = ["monitor", "--certificate", str(stated), "--state", str(state)]
    arguments += ["--attempt-log", write_attempts(log, range(10), 1)]
    with AttemptLog.open(log) as writer:
        assert main(arguments) == 0
        out, err = capsys.readouterr()
        assert "no alarm. 9 attempts, success rate 1.000" in out
        assert "1 outcome waits for the other attempts" in err
        once = state.read_bytes()
        assert main(arguments) == 0
        assert state.read_bytes() == once
        writer.add([frame(100, decision(100, gripper="robotiq"))])
        writer.add_outcome(OutcomeRecord("d100", False))
    write_attempts(log, range(10, 40), 5)
    assert main([*arguments, "--follow", "--json", str(tmp_path / "m.json")]) == 3
    out, err = capsys.readouterr()
    assert "ALARM since attempt" in out
    assert "1 (another gripper)" in err
    assert json.loads((tmp_path / "m.json").read_text())["alarm"] is True
    assert main([*arguments, "--close-unit"]) == 3
    assert main([*arguments, "--restart"]) == 0


def test_a_table_cannot_be_followed(
    certificate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_log(tmp_path / "log.csv", [True] * 10)
    assert "only an attempt log can be followed" in refused(
        monitor(certificate, tmp_path, log, "--follow"), capsys
    )
