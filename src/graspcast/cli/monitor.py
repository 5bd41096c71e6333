"""The verb ``monitor``: whether a guaranteed success rate still holds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_text
from graspcast.cli.options import (
    Verbs,
    add_json,
    new_verb,
    positive,
    share,
    write_json,
)
from graspcast.errors import InputError
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from graspcast.guarantees.certificate import Certificate
    from graspcast.guarantees.drift_monitor import DriftMonitor

__all__ = ["add"]

_POLL_S = 1.0


def add(verbs: Verbs) -> None:
    """Add the verb ``monitor``."""
    verb = new_verb(
        verbs,
        "monitor",
        _monitor,
        "whether a guaranteed success rate still holds",
        "Read the outcomes of attempts, in the order of the file, and raise an alarm when the\n"
        "guaranteed success rate no longer holds. The file is a table to which rows are appended,\n"
        "or the attempt log that robot, service or node write; what was read before is skipped,\n"
        "so the command can be repeated or interrupted.\n\n"
        "Exit code: 0 no alarm, 3 alarm (which stays until --restart), 2 a mistake in the input.",
    )
    verb.add_argument(
        "--certificate", metavar="PATH", type=Path, required=True, help="from certify"
    )
    verb.add_argument(
        "--state",
        metavar="PATH",
        type=Path,
        required=True,
        help="the monitor's state; made if it does not exist",
    )
    verb.add_argument(
        "--attempt-log",
        metavar="FILE",
        type=Path,
        required=True,
        help="an attempt log; or a table of attempted grasps, oldest first, with the columns of "
        "trial outcomes",
    )
    verb.add_argument(
        "--follow",
        action="store_true",
        help="go on reading an attempt log while it is written, and end with an alarm",
    )
    verb.add_argument(
        "--alpha",
        metavar="P",
        type=share,
        help="probability of ever raising a false alarm (default: 0.05, or the state's)",
    )
    verb.add_argument("--object", metavar="NAME", help="the guarantee for one object (lmo-5)")
    verb.add_argument(
        "--max-attempts-per-unit",
        metavar="N",
        type=positive,
        help="weight units by their number of attempts, of which none has more (default: all "
        "units equally)",
    )
    verb.add_argument(
        "--close-unit",
        action="store_true",
        help="the last unit of the log is complete: count it (of an attempt log: all episodes)",
    )
    verb.add_argument("--restart", action="store_true", help="reset evidence and alarm first")
    add_json(verb)


def _monitor(options: argparse.Namespace) -> int:
    from graspcast.guarantees.certificate import OVERALL, Certificate
    from graspcast.guarantees.monitor_state import MonitorState

    certificate = Certificate.load(options.certificate)
    guarantee = certificate.of(options.object or OVERALL)
    if guarantee.threshold is None:
        raise InputError(
            f"{options.certificate}: guarantees nothing ({guarantee}), so there is no rate to "
            "monitor"
        )
    if _is_log(options.attempt_log):
        return _monitor_log(options, certificate)
    if options.follow:
        raise InputError(
            f"{options.attempt_log}: is a table, and only an attempt log can be followed",
            parameters=("follow", "attempt_log"),
        )
    state = MonitorState.open(
        options.state,
        options.certificate,
        guarantee,
        alpha=options.alpha,
        max_attempts_per_unit=options.max_attempts_per_unit,
    )
    monitor = state.monitor
    if options.restart:
        monitor.restart()
    _note_weight(certificate, monitor)
    new = state.update(options.attempt_log, certificate.provenance)
    if options.close_unit:
        monitor.close_unit()
    state.save()
    write_json(options.json, monitor.as_dict())
    alarm = f"ALARM since attempt {monitor.alarm_at}" if monitor.alarm else "no alarm"
    rate = f"{monitor.successes / monitor.trials:.3f}" if monitor.trials else "-"
    print_text(
        f"{guarantee.scope}: {alarm}. {new} new attempts, {monitor.trials} in all, success rate "
        f"{rate}; guaranteed: {guarantee.rate:g}. E-value {monitor.e_value:.3g} (at most "
        f"{monitor.max_e_value:.3g} so far); the alarm is raised at {1 / monitor.alpha:g}"
    )
    return 3 if monitor.alarm else 0


def _note_weight(certificate: Certificate, monitor: DriftMonitor) -> None:
    if certificate.weight == "attempt" and monitor.max_attempts_per_unit is None:
        note(
            "this guarantee weights all attempts equally; without --max-attempts-per-unit the "
            "monitor weights all units equally"
        )


def _is_log(path: Path) -> bool:
    """Return whether a file is SQLite's; what cannot be read is told by who reads it."""
    try:
        with path.open("rb") as stream:
            return path.is_file() and stream.read(16) == b"SQLite format 3\0"
    except OSError:
        return False


def _monitor_log(options: argparse.Namespace, certificate: Certificate) -> int:
    """Monitor an attempt log, once or until an alarm."""
    import time

    from graspcast.attempt_log import AttemptLog
    from graspcast.guarantees.certificate import OVERALL
    from graspcast.guarantees.log_monitor_state import LogMonitorState

    state = LogMonitorState.open(
        options.state,
        options.certificate,
        options.object or OVERALL,
        alpha=options.alpha,
        max_attempts_per_unit=options.max_attempts_per_unit,
    )
    monitor = state.monitor
    if options.restart:
        monitor.restart()
    _note_weight(certificate, monitor.monitor)
    log = AttemptLog.read(options.attempt_log)
    status = monitor.update(log)
    try:
        while options.follow and not status.alarm:
            state.save()
            time.sleep(_POLL_S)
            status = monitor.update(log)
    except KeyboardInterrupt:
        note("interrupted; the state is saved")
    if options.close_unit:
        monitor.close_episodes()
        status = monitor.status
    state.save()
    write_json(options.json, status.as_dict())
    if status.left_out:
        reasons = ", ".join(f"{n} ({why})" for why, n in status.left_out.items())
        note(f"outcomes that do not count: {reasons}")
    if status.waiting:
        waiting = counted(status.waiting, "outcome", "waits", "wait")
        note(f"{waiting} for the other attempts of the episode, or for the next episode")
    print_text(status.message)
    return 3 if status.alarm else 0
