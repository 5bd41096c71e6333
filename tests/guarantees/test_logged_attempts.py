"""What a guarantee is about, from what its certificate states."""

from __future__ import annotations

from attempt_records import certified
from graspcast.guarantees.logged_attempts import LoggedDecision, Scope


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
