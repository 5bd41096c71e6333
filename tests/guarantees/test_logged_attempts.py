"""What a guarantee is about, from what its certificate states."""

from __future__ import annotations

from dataclasses import replace

import pytest

from attempt_records import certified
from graspcast.guarantees.logged_attempts import LoggedDecision, Scope
from graspcast.guarantees.look_policy import LookPolicy


def scope(**provenance: object) -> Scope:
    return Scope.of(certified(**provenance), "all objects")


def decided(**changed: object) -> LoggedDecision:
    values = {
        "episode": "e",
        "instance": 0,
        "object_name": "ycbv-5",
        "action": "attempt",
        "probability": 0.99,
        "threshold": 0.8,
        "model": "m",
        "guide": "fused",
        "gripper": "franka",
        "grasp": "side",
    }
    return LoggedDecision(**(values | changed))


def test_what_is_not_stated_is_not_asked_for() -> None:
    assert not scope().why_not(decided())


def test_guides_of_a_policy_stand_for_the_principal() -> None:
    assert scope(principal="epos").why_not(decided()) == "another guide"
    assert not scope(principal="epos", guides=["epos", "fused"]).why_not(decided())


def test_one_of_several_grasps_and_datasets() -> None:
    assert not scope(grasp=["reference", "side"]).why_not(decided())
    assert scope(datasets=["lmo", "tless"]).why_not(decided()) == "another dataset"


@pytest.mark.parametrize(
    ("looks", "off", "why"),
    [
        (1, 0.0, ""),
        (1, 1e-3, "another threshold"),
        (1, -1e-3, ""),  # what would be attempted in addition is told by its probability
        (2, -1e-3, "another threshold"),  # it decides after which look is attempted
        (2, 1e-3, "another threshold"),
        (2, 0.0, ""),
        (None, -1e-3, ""),
    ],
)
def test_the_threshold_is_the_certified_one(looks: int | None, off: float, why: str) -> None:
    policy = LookPolicy("fused", True, looks or 1, 3, "earlier", 12.0, 0.0, 0.0, 0.0)
    certificate = replace(certified(), policy=None if looks is None else policy)
    one = Scope.of(certificate, "all objects")
    assert one.looks == (looks == 2)
    assert one.why_not(decided(threshold=one.threshold + off)) == why
    low = decided(threshold=one.threshold, probability=one.threshold - 1e-6)
    assert one.why_not(low) == "below the certified threshold"
    assert not one.why_not(decided(threshold=one.threshold, probability=one.threshold))


def test_what_an_attempt_needs() -> None:
    one = scope(model="m", gripper="franka", datasets="ycbv")
    assert not one.why_not(decided(threshold=one.threshold))
    for changed, why in (
        ({"model": "other"}, "another model"),
        ({"gripper": "other"}, "another gripper"),
        ({"object_name": "lmo-5"}, "another dataset"),
        ({"action": "abstain"}, "tried in spite of the decision"),
        ({"probability": None}, "no forecast"),
        ({"threshold": None}, "no forecast"),
    ):
        assert one.why_not(decided(**({"threshold": one.threshold} | changed))) == why
