"""What is missing, and how to get it."""

from __future__ import annotations

import shlex
from dataclasses import replace

from graspcast.cli import parser
from graspcast.report.missing import missing_of
from graspcast.report.run_data import RunData


def test_every_command_is_one_of_ours_with_options_that_there_are(run: RunData) -> None:
    top = parser()
    bare = replace(run, decisions=None, trials=())
    for found in (*missing_of(run), *missing_of(bare)):
        if not found.command:
            continue
        _, verb, *words = shlex.split(found.command)
        from graspcast.cli import verb_parsers

        known = verb_parsers(top)[verb]._option_string_actions
        assert all(word in known for word in words if word.startswith("--")), found.command


def test_what_is_there_is_not_missing(run: RunData) -> None:
    told = " ".join(item.what for item in missing_of(run, ("a note",)))
    assert "a note" in told and "Outcomes" not in told and "Verdicts, so" not in told
    assert "Images and models" in told and "certificate" in told and "Tolerance" in told
    bare = " ".join(item.what for item in missing_of(replace(run, decisions=None, trials=())))
    assert "Verdicts, so" in bare and "Outcomes, so" in bare
    one = replace(run, problems=("left out, x.csv: is wrong",))
    assert missing_of(one)[0].what == "left out, x.csv: is wrong"
