"""The state of a monitor of an attempt log, in a file."""

from __future__ import annotations

from pathlib import Path

import pytest

from attempt_records import certified, decision, frame
from graspcast.attempt_log import AttemptLog, OutcomeRecord
from graspcast.errors import FormatError, MismatchError
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.log_monitor import monitor_status
from graspcast.guarantees.log_monitor_state import LogMonitorState
from graspcast.guarantees.monitor_state import MonitorState
from graspcast.io.artefacts import read_artefact, write_artefact


@pytest.fixture
def certificate(tmp_path: Path) -> Path:
    path = tmp_path / "certificate.json"
    certified().save(path)
    return path


@pytest.fixture
def log(tmp_path: Path):
    with AttemptLog.open(tmp_path / "log.db") as log:
        yield log


def attempt(log: AttemptLog, *numbers: int) -> None:
    for i in numbers:
        log.add([frame(i, decision(i), decision(100 + i, instance=1))])
        log.add_outcome(OutcomeRecord(f"d{i}", i % 3 > 0))


def test_a_state_goes_on_where_it_was(tmp_path, certificate, log) -> None:
    for part in (range(5), range(0), range(5, 12)):
        attempt(log, *part)
        state = LogMonitorState.open(tmp_path / "state.json", certificate)
        state.monitor.update(log)
        state.save()
    log.add_outcome(OutcomeRecord("d103", False))
    state = LogMonitorState.open(tmp_path / "state.json", certificate)
    status = state.monitor.update(log)
    assert status == monitor_status(log, Certificate.load(certificate))
    assert status.waiting == 13


def test_states_of_others_are_refused(tmp_path, certificate, log) -> None:
    attempt(log, 0)
    path = tmp_path / "state.json"
    state = LogMonitorState.open(path, certificate, alpha=0.1)
    state.monitor.update(log)
    state.save()
    with pytest.raises(MismatchError, match=r"was made with alpha 0\.1, not 0.2"):
        LogMonitorState.open(path, certificate, alpha=0.2)
    with pytest.raises(MismatchError, match="a monitor of an attempt log, not of a table"):
        MonitorState.open(path, certificate, Certificate.load(certificate).overall)
    guarantee = Certificate.load(certificate).overall
    MonitorState.open(tmp_path / "t.json", certificate, guarantee).save()
    with pytest.raises(MismatchError, match="a monitor of a table, not of an attempt log"):
        LogMonitorState.open(tmp_path / "t.json", certificate)
    certified(rate=0.8).save(certificate)
    with pytest.raises(MismatchError, match="another guarantee"):
        LogMonitorState.open(path, certificate)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("outcomes_read", -1),
        ("outcomes_read", True),
        ("open", [["e", 1]]),
        ("open", 3),
        ("counted", None),
        ("left_out", []),
        ("left_out", {"late": "many"}),
    ],
)
def test_a_state_that_is_not_complete(tmp_path, certificate, log, name, value) -> None:
    path = tmp_path / "state.json"
    LogMonitorState.open(path, certificate).save()
    write_artefact(path, {**read_artefact(path, ""), name: value})
    with pytest.raises(FormatError, match="is not a complete monitor state"):
        LogMonitorState.open(path, certificate)
