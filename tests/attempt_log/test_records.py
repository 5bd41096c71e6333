from datetime import datetime, timedelta, timezone

import numpy as np
import pytest

from attempt_records import NOON, decision, frame, pose
from graspcast.attempt_log import OutcomeRecord
from graspcast.errors import InputError


@pytest.mark.ill_typed
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"id": ""}, "id is empty"),
        ({"id": None}, "id should be text"),
        ({"grasp": "a\0b"}, "no valid Unicode"),
        ({"reason": "\ud800"}, "no valid Unicode"),
        ({"reason": "x" * 10_001}, "10,001 characters"),
        ({"action": "grab"}, "not one of attempt, look again, abstain"),
        ({"instance": 1.5}, "instance should be a whole number"),
        ({"looks": True}, "looks should be a whole number"),
        ({"views": -1}, "of at least 0"),
        ({"probability": float("nan")}, "from 0 to 1"),
        ({"probability": 1.2}, "from 0 to 1"),
        ({"threshold": float("inf")}, "of at least 0"),
        ({"cam_T_obj": np.eye(3)}, "4x4 matrix"),
        ({"cam_T_obj": pose() * np.nan}, "4x4 matrix"),
        ({"world_T_obj": "no"}, "4x4 matrix"),
    ],
)
def test_decisions_that_cannot_be(changed, message):
    with pytest.raises(InputError, match=message):
        decision(0, **changed)


@pytest.mark.ill_typed
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"episode": ""}, "episode is empty"),
        ({"look": 0}, "of at least 1"),
        ({"K": np.eye(4)}, "3x3 matrix"),
        ({"time_utc": datetime(2026, 1, 1)}, "with a time zone"),
        ({"time_utc": "noon"}, "with a time zone"),
        ({"estimates": []}, "should map"),
        ({"estimates": {"": []}}, "no name of an estimator"),
        ({"estimates": {"a": [("ycbv-5", np.eye(3), 1.0)]}}, "by a should be triples"),
        ({"estimates": {"a": [("ycbv-5", pose(), float("nan"))]}}, "finite score"),
        ({"estimates": {"a": [("ycbv-5", pose())]}}, "should be triples"),
        ({"estimates": {"a": 3}}, "should be triples"),
        ({"decisions": [3]}, "sequence of DecisionRecord"),
        ({"decisions": [decision(1), decision(1)]}, "the same id"),
    ],
)
def test_frames_that_cannot_be(changed, message):
    with pytest.raises(InputError, match=message):
        frame(0, **changed)


@pytest.mark.ill_typed
@pytest.mark.parametrize("success", [1, "yes", None, float("nan")])
def test_success_is_true_or_false(success):
    with pytest.raises(InputError, match="True or False"):
        OutcomeRecord("d0", success)


def test_times_become_utc():
    local = NOON.astimezone(timezone(timedelta(hours=9)))
    assert OutcomeRecord("d0", True, time_utc=local).time_utc.hour == 12


def test_arrays_are_copies():
    mine = pose()
    kept = decision(0, cam_T_obj=mine)
    mine[0, 3] = 9.0
    assert kept.cam_T_obj[0, 3] == 0.0
