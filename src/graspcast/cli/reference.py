"""The reference of the command line as Markdown: ``python -m graspcast.cli.reference``."""

from __future__ import annotations

import argparse
import sys

from graspcast.cli import parser, verb_parsers

__all__ = ["render_reference"]

_INTRODUCTION = """\
# The command line

`graspcast VERB --help` says the same. Exit codes: 0 done, 2 a mistake in the input (one message, no
half-written file), 3 an alarm of `monitor`, 130 interrupted, 141 nobody reads the output any more.

Results go to standard output, notes and progress to standard error. On a terminal, progress is a
bar; elsewhere, as under `nohup` or in CI, a verb that takes longer writes a line every ten seconds,
such as `simulate: 1,240 of 5,000 trials (25%), 31/s, 2 min left`. The environment variable
`GRASPCAST_PROGRESS_S` sets the seconds between two lines, 0 none.
"""


def render_reference() -> str:
    """Return all verbs and options as Markdown, made from the parser itself."""
    top = parser()
    parts = [_INTRODUCTION]
    parts += [_verb(name, verb) for name, verb in verb_parsers(top).items()]
    return "\n".join(parts)


def _verb(name: str, verb: argparse.ArgumentParser) -> str:
    rows = [_row(action) for action in verb._actions if action.dest != "help"]
    table = ["| option | meaning |", "|---|---|", *rows] if rows else []
    return "\n".join([f"## {name}", "", verb.description or "", "", *table, ""])


def _row(action: argparse.Action) -> str:
    metavar = action.metavar or ("" if action.nargs == 0 else action.dest.upper())
    if action.choices is not None and not action.metavar:
        metavar = "{" + ",".join(map(str, action.choices)) + "}"
    if isinstance(metavar, tuple):
        metavar = " ".join(metavar)
    if action.nargs == "+":
        metavar = f"{metavar} [{metavar} ...]"
    name = f"{action.option_strings[-1]} {metavar}" if action.option_strings else metavar
    meaning = " ".join((action.help or "").split())
    if action.required and action.option_strings:
        meaning += " (required)"
    return f"| `{name.strip().replace('|', chr(92) + '|')}` | {meaning} |"


if __name__ == "__main__":
    sys.stdout.write(render_reference())
