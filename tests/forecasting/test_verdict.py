"""Verdicts: the threshold, and the file."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.errors import InputError
from graspcast.forecasting.verdict import (
    Verdict,
    VerdictRow,
    check_threshold,
    decide,
    read_verdicts,
    write_verdicts,
)

share = st.floats(0, 1)


@given(share, share)
def test_attempt_at_the_threshold_or_above(probability: float, threshold: float) -> None:
    verdict = decide(probability, threshold)
    assert verdict.attempt == (probability >= threshold)
    assert str(verdict) == ("attempt" if verdict.attempt else "abstain")
    assert verdict.probability == probability


def test_the_reason_states_both_numbers() -> None:
    assert decide(0.75, 0.75) == Verdict(True, 0.75, "probability 0.750 >= 0.75", 0.75)
    assert decide(0.7499, 0.75).reason == "probability 0.750 < 0.75"
    assert decide(0.1, 0.5).reason == "probability 0.100 < 0.5"


@pytest.mark.parametrize("threshold", [-1e-9, 1 + 1e-9, float("nan"), float("inf")])
def test_a_threshold_that_is_no_probability(threshold: float) -> None:
    with pytest.raises(InputError, match=f"between 0 and 1, not {threshold}"):
        check_threshold(threshold)


@given(share)
def test_a_threshold_that_is_one(threshold: float) -> None:
    assert check_threshold(threshold) == threshold


def test_the_file_to_the_letter(tmp_path: Path) -> None:
    rows = [
        VerdictRow(2, 3, 1, "parallel", decide(0.9, 0.5)),
        VerdictRow(2, 4, 1, "parallel", Verdict(False, None, "none by epos, gdrnpp")),
        VerdictRow(2, 5, 12, "parallel", Verdict(False, 0.25, 'an object that is "unseen"')),
    ]
    write_verdicts(tmp_path / "verdicts.csv", rows)
    assert (tmp_path / "verdicts.csv").read_bytes().decode() == (
        "scene_id,im_id,obj_id,gripper,probability,verdict,reason\n"
        "2,3,1,parallel,0.900000,attempt,probability 0.900 >= 0.5\n"
        '2,4,1,parallel,,abstain,"none by epos, gdrnpp"\n'
        '2,5,12,parallel,0.250000,abstain,"an object that is ""unseen"""\n'
    )


# Python's csv quotes no lone carriage return; reasons and names of grippers have none.
texts = st.text(st.characters(codec="utf-8", exclude_characters="\0\r"), max_size=20)


@given(st.lists(st.tuples(st.integers(0, 10**6), texts, st.none() | share), max_size=5))
def test_whatever_the_reason_the_file_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, given_rows: list[tuple[int, str, float | None]]
) -> None:
    path = tmp_path_factory.mktemp("verdicts") / "verdicts.csv"
    rows = [VerdictRow(1, i, 2, "hand", Verdict(False, p, why)) for i, why, p in given_rows]
    write_verdicts(path, rows)
    with path.open(encoding="utf-8", newline="") as stream:
        read = list(csv.DictReader(stream))
    assert [(int(r["im_id"]), r["reason"]) for r in read] == [(i, w) for i, w, _ in given_rows]
    for row, (_, _, probability) in zip(read, given_rows, strict=True):
        if probability is None:
            assert row["probability"] == ""
        else:
            assert np.isclose(float(row["probability"]), probability, atol=5e-7)
    back = read_verdicts(path)
    assert [(r.im_id, r.verdict.reason) for r in back] == [(i, w) for i, w, _ in given_rows]


def test_no_verdicts_is_a_header(tmp_path: Path) -> None:
    write_verdicts(tmp_path / "deep" / "verdicts.csv", [])
    text = (tmp_path / "deep" / "verdicts.csv").read_text()
    assert text == "scene_id,im_id,obj_id,gripper,probability,verdict,reason\n"
