from types import SimpleNamespace as Message

import pytest

from graspcast.ros.diagnostics import (
    ERROR,
    OK,
    WARN,
    diagnostic_array,
    judging_status,
    monitor_status,
)
from graspcast.ros.problems import Problems

pytestmark = pytest.mark.ill_typed  # a judge with nothing but its counts


def judge(frames, *kinds):
    problems = Problems()
    for kind in kinds:
        problems.add(kind)
    return Message(problems=problems, frames=frames, judged=frames)


def test_new_problems_are_a_warning_and_old_ones_are_figures():
    status = judging_status(judge(3, "late", "late"), {"late": 1})
    assert (status.level, status.message) == (WARN, "late")
    assert status.values == {"frames": "3", "judged": "3", "late": "2"}
    assert judging_status(judge(3, "late"), {"late": 1}).level == OK


def test_silence_is_a_warning():
    status = judging_status(judge(0), {})
    assert (status.level, status.message) == (WARN, "no estimates have come so far")


def test_an_alarm_of_the_monitor_is_an_error():
    assert monitor_status(True, "ALARM").level == ERROR
    assert monitor_status(False, "no alarm").level == OK


def test_the_message_has_a_status_for_each_part():
    def make(type_name, /, **fields):
        return Message(type_name=type_name, **fields)

    parts = [judging_status(judge(1), {}), monitor_status(True, "ALARM")]
    array = diagnostic_array(make, parts, 1_500_000_000, "graspcast")
    assert (array.header.stamp.sec, array.header.stamp.nanosec) == (1, 500_000_000)
    assert [s.name for s in array.status] == ["graspcast: judging", "graspcast: guarantee"]
    assert [s.level for s in array.status] == [b"\x00", b"\x02"]
    assert {v.key: v.value for v in array.status[0].values} == {"frames": "1", "judged": "1"}
