"""The verb ``monitor``: whether a certificate still holds."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import note, print_text
from graspcast.cli.options import (
    Verbs,
    add_json,
    count,
    new_verb,
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
        "whether a promise still holds in the field",
        "Take in the outcomes of attempts in the field, in the order of the file, and raise an\n"
        "alarm when the promised rate no longer holds. The file is a log that grows: what was\n"
        "taken in before is skipped, so the command may be repeated, or killed, at any time.\n\n"
        "Exit code: 0 no alarm, 3 alarm (which stays until --restart), 2 something is wrong.",
    )
    verb.add_argument(
        "--certificate", metavar="PATH", type=Path, required=True, help="from certify"
    )
    verb.add_argument(
        "--state", metavar="PATH", type=Path, required=True, help="made if it is not there"
    )
    verb.add_argument(
        "--outcomes",
        metavar="FILE",
        type=Path,
        required=True,
        help="the log of attempted grasps: columns as those of trial outcomes, oldest first",
    )
    verb.add_argument(
        "--alpha",
        metavar="P",
        type=share,
        help="chance that there is ever a false alarm (default: 0.05, or the state's)",
    )
    verb.add_argument("--object", metavar="NAME", help="the promise of one object (lmo-5)")
    verb.add_argument(
        "--most-attempts",
        metavar="N",
        type=count,
        help="units count by their attempts, of which none has more (default: all alike)",
    )
    verb.add_argument(
        "--close", action="store_true", help="the last unit of the log is over: weigh it too"
    )
    verb.add_argument(
        "--restart", action="store_true", help="forget evidence and alarm before going on"
    )
    add_json(verb)


def _monitor(options: argparse.Namespace) -> int:
    from graspcast.guarantees.certificate import OVERALL, Certificate
    from graspcast.guarantees.monitor_state import MonitorState

    certificate = Certificate.load(options.certificate)
    guarantee = certificate.of(options.object or OVERALL)
    if guarantee.threshold is None:
        raise InputError(
            f"{options.certificate}: promises nothing ({guarantee}); there is no rate to watch"
        )
    log = MonitorState.open(
        options.state,
        options.certificate,
        guarantee,
        alpha=options.alpha,
        most_attempts=options.most_attempts,
    )
    if options.restart:
        log.monitor.restart()
    by_unit = options.most_attempts is None and log.monitor.most_attempts is None
    if certificate.weight == "attempt" and by_unit:
        note(
            "every attempt counts in this promise; without --most-attempts, every unit counts alike"
        )
    new = log.update(options.outcomes, certificate.provenance)
    if options.close:
        log.monitor.close()
    log.save()
    monitor = log.monitor
    write_json(options.json, monitor.as_dict())
    state = f"ALARM since attempt {monitor.alarm_at}" if monitor.alarm else "no alarm"
    rate = f"{monitor.successes / monitor.trials:.3f}" if monitor.trials else "-"
    print_text(
        f"{guarantee.scope}: {state}. {new} new attempts, {monitor.trials} in all, {rate} of them "
        f"held; {guarantee.rate:g} is promised. Evidence against it: {monitor.evidence:.3g} of the "
        f"{1 / monitor.alpha:g} that raise an alarm (at most {monitor.evidence_peak:.3g} so far)"
    )
    return 3 if monitor.alarm else 0
