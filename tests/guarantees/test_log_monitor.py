"""Monitors that follow an attempt log: units, what counts, and outcomes out of order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attempt_records import certified, decision, frame
from graspcast.attempt_log import AttemptLog, OutcomeRecord
from graspcast.errors import InputError, MismatchError
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.certify import certify
from graspcast.guarantees.drift_monitor import DriftMonitor
from graspcast.guarantees.log_monitor import LogMonitor, monitor_status
from worlds import ASKED

PROVENANCE = {
    "model": "m" * 64,
    "principal": "epos",
    "gripper": "franka",
    "grasp": "reference",
    "datasets": ["ycbv"],
    "unit": "scene",
}


@pytest.fixture(scope="module")
def certificate() -> Certificate:
    return certified(**PROVENANCE)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "log.db"


def scene(number: int, attempts: int = 2, **changed: object):
    """A frame with several attempts, d<number>.<instance>."""
    made = [
        decision(0, id=f"{number}.{i}", instance=i, object_name=f"ycbv-{5 + i}", **changed)
        for i in range(attempts)
    ]
    return frame(number, *made)


def write(path: Path, frames, outcomes) -> None:
    with AttemptLog.open(path) as log:
        log.add(frames)
        for name, success in outcomes:
            log.add_outcome(OutcomeRecord(name, success))


def straight(*units) -> DriftMonitor:
    monitor = DriftMonitor(0.9)
    for number, unit in enumerate(units):
        for success in unit:
            monitor.observe(success, str(number))
        monitor.close_unit()
    return monitor


def followed(path: Path, certificate: Certificate, **options: object) -> LogMonitor:
    monitor = LogMonitor.of(certificate, **options)
    monitor.update(AttemptLog.read(path))
    return monitor


def test_interleaved_outcomes_count_by_episode(path, certificate) -> None:
    order = [("0.0", True), ("1.0", False), ("0.1", False), ("1.1", True), ("2.0", True)]
    write(path, [scene(i) for i in range(3)], order)
    found = followed(path, certificate)
    assert found.monitor.log_wealth == straight((True, False), (False, True)).log_wealth
    assert (found.status.attempts, found.status.waiting) == (4, 1)
    found.close_episodes()
    assert found.monitor.log_wealth == straight((True, False), (False, True), (True,)).log_wealth


def test_updates_in_parts_are_those_of_one_pass(path, certificate) -> None:
    rng = np.random.default_rng(0)
    with AttemptLog.open(path) as log:
        parts = LogMonitor.of(certificate)
        waiting = []
        for i in range(60):
            log.add([scene(i)])
            waiting += [f"{i}.0", f"{i}.1"]
            rng.shuffle(waiting)
            for _ in range(rng.integers(0, 4)):
                if waiting:
                    log.add_outcome(OutcomeRecord(waiting.pop(), bool(rng.random() < 0.6)))
            if i % 7 == 0:
                parts.update(log)
        assert parts.update(log) == monitor_status(log, certificate)
        assert parts.status.attempts > 40
        assert parts.status.alarm


def test_an_alarm_is_raised_and_stays(path, certificate) -> None:
    frames = [scene(i, 1) for i in range(40)]
    write(path, frames, [(f"{i}.0", i < 5) for i in range(40)])
    found = followed(path, certificate)
    assert found.status.alarm
    assert "ALARM since attempt" in found.status.message
    found.restart()
    assert not found.update(AttemptLog.read(path)).alarm


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"model": "other"}, "another model"),
        ({"guide": "gdrnpp"}, "another guide"),
        ({"gripper": "robotiq"}, "another gripper"),
        ({"grasp": "side"}, "another grasp"),
        ({"action": "abstain"}, "tried in spite of the decision"),
        ({"threshold": 0.99}, "another threshold"),
        ({"probability": 0.5, "threshold": 0.4}, "below the certified threshold"),
        ({"probability": None}, "no forecast"),
    ],
)
def test_attempts_of_others_do_not_count(path, certificate, changed, why) -> None:
    write(path, [scene(0, **changed)], [("0.0", False), ("0.1", False)])
    status = followed(path, certificate).status
    assert (status.attempts, status.waiting) == (0, 0)
    assert status.left_out == {why: 2}


def test_a_guarantee_of_one_object_counts_that_one(path, certificate) -> None:
    write(path, [scene(i) for i in range(2)], [("0.1", True), ("0.0", False), ("1.1", False)])
    found = followed(path, certificate, scope="ycbv-6")
    assert (found.status.attempts, found.status.waiting) == (1, 1)
    assert found.status.left_out == {"another object": 1}


def test_an_episode_that_is_never_complete_does_not_wait_for_ever(path, certificate) -> None:
    outcomes = [("0.0", True), *((f"{i}.0", True) for i in range(1, 110)), ("0.1", False)]
    write(path, [scene(0), *(scene(i, 1) for i in range(1, 110))], outcomes)
    status = followed(path, certificate).status
    assert status.attempts == 110
    assert status.left_out == {"its episode was counted before it came": 1}


def test_a_second_grasp_of_an_instance_does_not_count(path, certificate) -> None:
    again = frame(0, decision(0, id="again"), look=2)
    write(path, [scene(0, 1), again, scene(1, 1)], [("0.0", False), ("again", True), ("1.0", True)])
    status = followed(path, certificate).status
    assert (status.attempts, status.successes) == (1, 0)
    assert status.left_out == {"a further grasp of the same instance": 1}


def test_another_log_is_refused(path, tmp_path, certificate) -> None:
    write(path, [scene(0)], [("0.0", True)])
    write(tmp_path / "other.db", [scene(0)], [("0.0", False)])
    found = followed(path, certificate)
    with pytest.raises(MismatchError, match="is not the log that was read before"):
        found.update(AttemptLog.read(tmp_path / "other.db"))


def test_a_limit_of_attempts_in_an_episode(path, certificate) -> None:
    write(path, [scene(0), scene(1)], [("0.0", True), ("0.1", True), ("1.0", True)])
    with pytest.raises(InputError, match="episode e0 has 2 attempts, more than 1"):
        followed(path, certificate, max_attempts_per_unit=1)


def test_a_certificate_without_a_guarantee_has_nothing_to_monitor() -> None:
    n = np.arange(10)
    poor = certify(np.full(10, 0.5), n < 0, n, **ASKED)
    with pytest.raises(InputError, match="guarantees nothing"):
        LogMonitor.of(poor)


def test_the_status_in_words(path, certificate) -> None:
    write(path, [scene(i, 1) for i in range(4)], [(f"{i}.0", i != 2) for i in range(4)])
    found = LogMonitor.of(certificate)
    assert "0 attempts, success rate -; guaranteed: 0.9" in found.status.message
    found.update(AttemptLog.read(path))
    found.close_episodes()
    e_value = straight((True,), (True,), (False,), (True,)).e_value
    assert found.status.message == (
        "all objects: no alarm. 4 attempts, success rate 0.750; guaranteed: 0.9. E-value "
        f"{e_value:.3g} (at most {found.status.max_e_value:.3g} so far); the alarm is raised at 20"
    )


def test_an_outcome_that_was_read_is_not_read_again(path, certificate) -> None:
    write(path, [scene(i, 1) for i in range(3)], [("0.0", True), ("1.0", False)])
    found = followed(path, certificate)
    before = found.status
    assert found.update(AttemptLog.read(path)) == before
    with AttemptLog.open(path) as log:
        log.add_outcome(OutcomeRecord("2.0", True))
        after = found.update(log)
    assert (before.outcomes_read, after.outcomes_read) == (2, 3)
    found.close_episodes()
    assert found.monitor.log_wealth == straight((True,), (False,), (True,)).log_wealth


def test_what_was_waiting_at_a_restart_does_not_count(path, certificate) -> None:
    write(path, [scene(0), scene(1)], [("0.0", True), ("1.0", True)])
    found = followed(path, certificate)
    assert found.status.waiting == 2
    found.restart()
    assert (found.status.waiting, found.status.attempts) == (0, 0)
    with AttemptLog.open(path) as log:
        log.add_outcome(OutcomeRecord("0.1", False))
        status = found.update(log)
    assert status.left_out == {"its episode was counted before it came": 1}
    assert (status.attempts, status.waiting) == (0, 0)


def test_an_episode_may_have_as_many_attempts_as_its_limit(path, certificate) -> None:
    write(path, [scene(0), scene(1)], [("0.0", True), ("0.1", True), ("1.0", True)])
    found = followed(path, certificate, max_attempts_per_unit=2)
    assert found.status.attempts == 2


def test_any_other_log_is_refused(path, tmp_path, certificate) -> None:
    """Whichever has the larger digest; and one that is shorter."""
    write(path, [scene(0)], [("0.0", True)])
    found = followed(path, certificate)
    for i in range(6):
        other = tmp_path / f"other{i}.db"
        write(other, [scene(i + 1)], [(f"{i + 1}.0", True)])
        with pytest.raises(MismatchError, match="is not the log that was read before"):
            found.update(AttemptLog.read(other))
    empty = tmp_path / "empty.db"
    write(empty, [scene(0)], [])
    with pytest.raises(MismatchError, match="outcome 1 is another"):
        found.update(AttemptLog.read(empty))
