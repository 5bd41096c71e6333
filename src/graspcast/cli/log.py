"""The verb ``log``: what an attempt log holds, shown, filtered, followed, exported and copied."""

from __future__ import annotations

import argparse
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspcast.cli.console import note, print_table, print_text
from graspcast.cli.options import Verbs, add_json, new_verb, positive, write_json
from graspcast.errors import InputError
from graspcast.io.wording import counted

if TYPE_CHECKING:
    import polars as pl

    from graspcast.attempt_log import AttemptLog, Wanted

__all__ = ["add"]

_POLL_S = 0.5


def add(verbs: Verbs) -> None:
    """Add the verb ``log``."""
    verb = new_verb(
        verbs,
        "log",
        _log,
        "what an attempt log holds",
        "Show the decisions and outcomes in an attempt log, also while it is being written: how\n"
        "many there are, and the last ones. Options choose which, and write them to a file.",
    )
    verb.add_argument("file", metavar="FILE", type=Path, help="the attempt log")
    for name, what in (
        ("object", "object (ycbv-5)"),
        ("gripper", "gripper"),
        ("grasp", "grasp"),
        ("action", "action (attempt, look again, abstain)"),
        ("model", "model, by the beginning of its digest"),
    ):
        verb.add_argument(
            f"--{name}",
            metavar="NAME",
            action="append",
            default=[],
            help=f"only decisions of this {what}; may be repeated",
        )
    verb.add_argument("--since", metavar="TIME", type=_time, help="only from then on (ISO 8601)")
    verb.add_argument("--until", metavar="TIME", type=_time, help="only before then")
    which = verb.add_mutually_exclusive_group()
    which.add_argument("--with-outcome", action="store_true", help="only those with an outcome")
    which.add_argument("--without-outcome", action="store_true", help="only those without")
    verb.add_argument(
        "--last", metavar="N", type=positive, default=10, help="show so many rows (default: 10)"
    )
    verb.add_argument(
        "--follow", action="store_true", help="go on showing what is added, until interrupted"
    )
    verb.add_argument(
        "--out", metavar="PATH", type=Path, help="write the decisions chosen (.parquet or .csv)"
    )
    verb.add_argument(
        "--copy", metavar="PATH", type=Path, help="write a copy of the whole log, in one file"
    )
    verb.add_argument(
        "--check", action="store_true", help="check that every row is as it was written"
    )
    verb.add_argument("--add-outcome", metavar="ID", help="write the outcome of a decision")
    verb.add_argument("--success", choices=("yes", "no"), help="of --add-outcome")
    verb.add_argument("--reason", metavar="TEXT", help="of --add-outcome: how it failed")
    add_json(verb)
    verb.set_defaults(outputs=("copy",), positional={"file": "FILE"})


def _log(options: argparse.Namespace) -> None:
    from graspcast.attempt_log import AttemptLog, Wanted
    from graspcast.attempt_log.copying import copy_log
    from graspcast.attempt_log.export import exported
    from graspcast.attempt_log.records import ACTIONS
    from graspcast.errors import UnknownNameError
    from graspcast.io.tables import write_table

    for action in options.action:
        if action not in ACTIONS:
            raise UnknownNameError("action", action, ACTIONS, parameters=("action",))
    if options.out and options.out.suffix not in (".parquet", ".csv"):
        raise InputError(
            f"{options.out}: decisions are written to .parquet or .csv", parameters=("out",)
        )
    if options.add_outcome is not None or options.success or options.reason is not None:
        _add_outcome(options)
    log = AttemptLog.read(options.file)
    if options.check:
        log.check()
        note(f"{options.file}: every row is as it was written")
    known = {(True, False): True, (False, True): False}
    wanted = Wanted(
        objects=options.object,
        grippers=options.gripper,
        grasps=options.grasp,
        actions=options.action,
        models=options.model,
        since=options.since,
        until=options.until,
        with_outcome=known.get((options.with_outcome, options.without_outcome)),
    )
    table = log.table(wanted)
    if table.is_empty():
        note(*_unknown(options, log.table()))
    counts = _counts(table)
    write_json(options.json, {"log": str(options.file), **counts})
    if options.copy:
        copy_log(log, options.copy)
        note(f"{options.copy}: a copy of the log")
    if options.out:
        write_table(options.out, exported(table, nested=options.out.suffix == ".parquet"))
    _show(table.tail(options.last), f"{options.file}, the last decisions")
    attempts = counted(counts["attempts"], "attempt")
    rate = f", {counts['succeeded']} succeeded" if counts["outcomes"] else ""
    where = f"{options.out}: " if options.out else ""
    print_text(
        f"{where}{counted(counts['decisions'], 'decision')}, {attempts}, "
        f"{counted(counts['outcomes'], 'outcome')}{rate}"
    )
    if options.follow:
        _follow(log, wanted, table)


def _add_outcome(options: argparse.Namespace) -> None:
    from graspcast.attempt_log import AttemptLog, OutcomeRecord
    from graspcast.attempt_log.database import check_file

    if options.add_outcome is None or options.success is None:
        raise InputError(
            "an outcome has a decision and a success: give both",
            parameters=("add_outcome", "success"),
        )
    check_file(options.file, there=True)  # a log is not made by a name that was mistyped
    outcome = OutcomeRecord(options.add_outcome, options.success == "yes", options.reason)
    with AttemptLog.open(options.file) as log:
        new = log.add_outcome(outcome)
    note(f"the outcome of {options.add_outcome} {'is written' if new else 'was there already'}")


def _counts(table: pl.DataFrame) -> dict[str, int]:
    return {
        "decisions": len(table),
        "attempts": int((table["action"] == "attempt").sum()),
        "outcomes": int(table["success"].count()),
        "succeeded": int(table["success"].sum() or 0),
    }


def _unknown(options: argparse.Namespace, whole: pl.DataFrame) -> list[str]:
    """Say which names that were asked for are in no decision, and which are."""
    out = []
    for what, column in (("object", "object_name"), ("gripper",) * 2, ("grasp",) * 2):
        has = set(whole[column])
        some = ", ".join(map(_plain, sorted(has))) or "none"
        lacking = [name for name in getattr(options, what) if name not in has]
        out += [f"no decision of {what} {name}; the log has: {some}" for name in lacking]
    has = {digest for digest in whole["model"] if digest}
    for name in options.model:
        if not any(digest.startswith(name) for digest in has):
            some = ", ".join(digest[:12] for digest in sorted(has)) or "none"
            out.append(f"no decision by a model {name}; the log has: {some}")
    return out


def _follow(log: AttemptLog, wanted: Wanted, shown: pl.DataFrame) -> None:
    """Print what is added, decisions and outcomes, in the order in which they came."""
    from dataclasses import replace

    last = int(shown["seq"].max() or 0)  # type: ignore[arg-type]
    outcome = int(shown["outcome_seq"].max() or 0)  # type: ignore[arg-type]
    kept = set(shown["id"])
    while True:
        time.sleep(_POLL_S)
        for row in log.table(replace(wanted, after=last, with_outcome=None)).iter_rows(named=True):
            last = row["seq"]
            kept.add(row["id"])
            print_text(" ".join(_words({**row, "success": None})))
        for row in log.outcomes(after=outcome).iter_rows(named=True):
            outcome = row["seq"]
            if row["decision_id"] in kept:
                held = "succeeded" if row["success"] else "failed"
                why = f" ({_plain(row['reason'])})" if row["reason"] else ""
                print_text(f"{_plain(row['decision_id'])} {held}{why}")


def _show(table: pl.DataFrame, title: str) -> None:
    header = ["seq", "time (UTC)", "id", "object", "grasp", "action", "p", "threshold", "outcome"]
    rows = [_words(row) for row in table.iter_rows(named=True)]
    if rows:
        print_table(title, header, rows)


def _words(row: dict[str, Any]) -> list[str]:
    held = {None: "-", True: "succeeded", False: "failed"}[row["success"]]
    return [
        str(row["seq"]),
        row["time_utc"].strftime("%Y-%m-%d %H:%M:%S"),
        _plain(row["id"]),
        _plain(row["object_name"]),
        _plain(row["grasp"]),
        row["action"],
        "-" if row["probability"] is None else f"{row['probability']:.3f}",
        "-" if row["threshold"] is None else f"{row['threshold']:.3f}",
        held,
    ]


def _plain(text: str) -> str:
    """Return text without what a terminal would take for a command."""
    return "".join(c if c.isprintable() else "?" for c in text)


def _time(text: str) -> datetime:
    try:
        found = datetime.fromisoformat(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"a time as 2026-03-01 or 2026-03-01T12:00:00+00:00 is wanted, not {text!r}"
        ) from error
    return found.replace(tzinfo=UTC) if found.tzinfo is None else found
