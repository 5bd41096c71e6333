"""What certify prints of promises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from graspcast.cli.promises import confidence_of, print_alternatives, promised, rate_of
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.certify import certify
from graspcast.guarantees.promises import Alternative, Promise
from graspcast.guarantees.threshold_sequence import ThresholdSequence
from worlds import ASKED

SEQUENCE = ThresholdSequence((0.9,), (1.0,), "the test")


def certified(scenes: int, held: int, *, accept_lower: bool = False) -> Certificate:
    success = np.arange(scenes) < held
    given = np.full(scenes, 0.95), success, np.arange(scenes)
    return certify(*given, sequence=SEQUENCE, accept_lower=accept_lower, **ASKED)


def test_figures_are_never_rounded_up() -> None:
    assert rate_of(Promise(0.5, 0.7999, 10, 9)) == "0.799"
    assert rate_of(None) == "-"
    assert confidence_of(0.89996) == "0.899"
    assert confidence_of(0.9) == "0.900"


def test_too_few_scenes_get_an_answer() -> None:
    said = promised(certified(10, 10), "scene")
    assert "Promised with confidence 0.9: a success rate of 0.794" in said
    assert "10 of 10 drawn attempts succeeded" in said
    assert "--accept-lower" in said
    assert "From 10 scenes no rate above 0.794 can be promised" in said
    assert "it would have been promised with confidence 0.651 at most" in said
    assert "The cheapest way to 0.9: 22 new scenes" in said


def test_what_was_asked_for_is_promised_and_more_would_have_been() -> None:
    said = promised(certified(60, 60), "scene")
    assert said.startswith("What was asked for is promised. Had it been asked for beforehand")
    assert "a rate of 0.962" in said and "confidence 0.998" in said
    assert "--accept-lower" not in said


def test_what_was_accepted_is_said_to_be_lower() -> None:
    said = promised(certified(10, 9, accept_lower=True), "scene")
    assert "cannot be promised from these 10 scenes" in said
    assert "Accepted, and promised with confidence 0.9: 0.663" in said


def test_nothing_is_promised_where_nothing_succeeds() -> None:
    said = promised(certified(10, 0), "scene")
    assert "no rate above 0 can be promised" in said
    assert "no confidence worth asking for would have been enough" in said


def test_alternatives_are_called_no_promises(capsys: pytest.CaptureFixture[str]) -> None:
    given = np.full(10, 0.95), np.ones(10, bool), np.arange(10)
    certificate = certify(*given, sequence=SEQUENCE, **ASKED)
    print_alternatives(certificate)
    assert capsys.readouterr().out == ""
    others = (
        Alternative("one look", "scene", 10, None, Promise(0.9, 0.5, 9, 7), 0.2, 40),
        Alternative("all scenes weighted equally", "scene", 10, 0.8, None, 0.95, None),
    )
    print_alternatives(replace(certificate, alternatives=others))
    assert "Fewer" not in promised(replace(certificate, alternatives=others), "scene")
    fewer = replace(others[0], needed_units=12)
    said = promised(replace(certificate, alternatives=(fewer,)), "scene")
    assert "if it is asked for beforehand: one look, 12 new scenes" in said
    out = capsys.readouterr().out
    assert "no promises" in out
    assert "one look" in out and "10 scenes" in out and "40" in out
