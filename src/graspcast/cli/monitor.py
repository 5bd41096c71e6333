"""The verb ``monitor``: whether a guaranteed success rate still holds."""

from __future__ import annotations

import argparse
from pathlib import Path

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

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``monitor``."""
    verb = new_verb(
        verbs,
        "monitor",
        _monitor,
        "whether a guaranteed success rate still holds",
        "Read the outcomes of attempts, in the order of the file, and raise an alarm when the\n"
        "guaranteed success rate no longer holds. The file is a log to which rows are appended;\n"
        "rows that were read before are skipped, so the command can be repeated or interrupted.\n\n"
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
        help="attempted grasps, oldest first, with the columns of trial outcomes",
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
        "--close-unit", action="store_true", help="the last unit of the log is complete: count it"
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
    if certificate.weight == "attempt" and monitor.max_attempts_per_unit is None:
        note(
            "this guarantee weights all attempts equally; without --max-attempts-per-unit the "
            "monitor weights all units equally"
        )
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
