"""Findings: order and JSON."""

from __future__ import annotations

import json

import numpy as np

from graspcast.diagnosis.finding import Finding, by_severity


def test_the_gravest_first_and_else_as_found() -> None:
    found = [
        Finding(s, c, "f", "m", "c") for s, c in (("note", "a"), ("error", "b"), ("error", "c"))
    ]
    assert [f.code for f in by_severity(found)] == ["b", "c", "a"]


def test_as_json_with_numbers_and_repair() -> None:
    finding = Finding(
        "error", "x", "f.csv", "is wrong", "Mend it", {"n": np.int64(3)}, {5: np.eye(4)}, "epos"
    )
    content = json.loads(json.dumps(finding.as_dict()))
    assert content["numbers"] == {"n": 3}
    assert content["repair"] == {"5": np.eye(4).tolist()}
    assert content["estimator"] == "epos"
    assert str(finding) == "error x: f.csv: is wrong. Mend it"


def test_what_there_is_none_of_is_left_out_of_json() -> None:
    content = Finding("note", "x", "f.csv", "is so", "Leave it", {"why": "text"}).as_dict()
    assert content["numbers"] == {"why": "text"}
    assert not {"repair", "estimator"} & set(content)
