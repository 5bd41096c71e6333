from pathlib import Path

import pytest

from graspcast.errors import InputError
from graspcast.ros.parameters import PARAMETERS, node_settings, pairs

GIVEN = {
    "model": ["a.npz", ""],
    "estimates": ["epos=/epos", "gdrnpp = /gdrnpp "],
    "objects": ["mustard=ycbv-5"],
    "camera_frame": "camera",
}


def test_parameters_become_settings_and_empty_ones_are_not_given():
    given = node_settings(GIVEN)
    assert given.models == (Path("a.npz"),) and given.certificates == ()
    assert given.topics == {"epos": "/epos", "gdrnpp": "/gdrnpp"}
    assert given.options == {"threshold": None, "guide": None, "max_looks": 3}
    assert given.settings.objects == {"mustard": "ycbv-5"}
    assert given.settings.world_frame is None and given.attempt_log is None


def test_what_is_given_is_passed_on():
    more = {
        "threshold": 0.8,
        "guide": "fused",
        "attempt_log": "~/log.sqlite",
        "world_frame": "base",
    }
    given = node_settings(GIVEN | more)
    assert given.options == {"threshold": 0.8, "guide": "fused", "max_looks": 3}
    assert given.attempt_log == Path("~/log.sqlite").expanduser()
    assert given.settings.world_frame == "base"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"model": [""]}, "the parameter model should be given"),
        ({"estimates": []}, "the parameter estimates should be given"),
        ({"estimates": ["/epos"]}, "should be NAME=TOPIC, not '/epos'"),
        ({"objects": ["mustard="]}, "should be CLASS=OBJECT"),
        ({"estimates": ["a=/x", "a=/y"]}, "has 'a' twice"),
        ({"camera_frame": ""}, "optical frame should be named"),
        ({"diagnostics_period_s": 0.0}, "should be above 0"),
    ],
)
def test_parameters_that_say_nothing_sensible_are_refused(changes, said):
    with pytest.raises(InputError, match=said):
        node_settings(GIVEN | changes)


def test_defaults_are_of_kinds_that_ros_knows_and_lists_are_not_empty():
    for parameter in PARAMETERS:
        assert isinstance(parameter.default, str | int | float | list)
        assert parameter.default != [] and parameter.description.endswith(".")


def test_pairs_keep_further_signs_in_the_value():
    assert pairs(["a=b=c"], "objects") == {"a": "b=c"}
