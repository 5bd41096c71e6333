"""The policy of a certificate: as plain values, and what differs between two."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from graspcast.errors import MismatchError
from graspcast.guarantees.look_policy import LookPolicy, check_policy

POLICY = LookPolicy("fused", True, 3, 3, "earlier", 12.0, 0.001, 0.0017, 0.02)


def test_it_is_read_as_it_was_written() -> None:
    assert LookPolicy.from_dict(POLICY.as_dict()) == POLICY


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"max_looks": 0}, ValueError),
        ({"max_views": 2.5}, ValueError),
        ({"views": "yes"}, ValueError),
        ({"guide": 3}, ValueError),
        ({"min_gain": "much"}, ValueError),
        ({"min_gain": None}, TypeError),
    ],
)
def test_damaged_values_are_refused(change: dict[str, Any], error: type[Exception]) -> None:
    with pytest.raises(error):
        LookPolicy.from_dict({**POLICY.as_dict(), **change})
    with pytest.raises(KeyError):
        LookPolicy.from_dict({"guide": "fused"})


def test_what_differs_is_named() -> None:
    check_policy(POLICY, POLICY)
    check_policy(None, None)
    check_policy(POLICY, replace(POLICY, min_parallax_deg=12.0 + 1e-9))
    other = replace(POLICY, guide="best", max_looks=2, translation_sd_m=0.0)
    with pytest.raises(MismatchError) as caught:
        check_policy(POLICY, other)
    said = str(caught.value)
    assert "guide is fused, not best" in said and "max_looks is 3, not 2" in said
    assert "translation_sd_m is 0.001, not 0" in said and "views_from" not in said
    assert caught.value.parameters == ("guide", "max_looks", "camera_noise")


def test_one_view_and_several_are_told_apart() -> None:
    with pytest.raises(MismatchError, match="is of one view, guided by the principal, but the ver"):
        check_policy(None, POLICY)
    with pytest.raises(MismatchError, match="guide fused, up to 3 looks, but the verdicts are of"):
        check_policy(POLICY, None)
    assert str(replace(POLICY, max_looks=1)) == "guide fused, up to 3 views"
    assert str(replace(POLICY, max_looks=1, views=False)) == "guide fused, one view"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"max_looks": 2}, "guide fused, up to 2 looks"),
        ({"max_looks": 1, "max_views": 2}, "guide fused, up to 2 views"),
        ({"max_looks": 1, "max_views": 1}, "guide fused, one view"),
        ({"max_looks": 2, "views": False}, "guide fused, up to 2 looks"),
    ],
)
def test_a_policy_in_words(change: dict[str, Any], words: str) -> None:
    assert str(replace(POLICY, **change)) == words


@pytest.mark.parametrize(
    ("mine", "theirs", "named"),
    [
        ((3, 3), (2, 2), ["max_looks"]),  # the number of views follows from that of looks
        ((2, 2), (3, 3), ["max_looks"]),
        ((2, 2), (1, 3), ["max_looks", "max_views"]),
        ((1, 3), (2, 2), ["max_looks", "max_views"]),
        ((2, 3), (2, 2), ["max_views"]),
        ((1, 3), (1, 2), ["max_views"]),
    ],
)
def test_where_looks_differ_views_do_not_have_to_be_named(
    mine: tuple[int, int], theirs: tuple[int, int], named: list[str]
) -> None:
    first, second = (
        replace(POLICY, max_looks=looks, max_views=views) for looks, views in (mine, theirs)
    )
    assert list(first.differences(second)) == named


@pytest.mark.parametrize("name", ["min_parallax_deg", "rotation_sd_rad", "min_gain"])
def test_numbers_may_differ_by_rounding_alone(name: str) -> None:
    value = getattr(POLICY, name)
    assert not POLICY.differences(replace(POLICY, **{name: value * (1 + 5e-7)}))
    assert list(POLICY.differences(replace(POLICY, **{name: value * (1 + 5e-6)}))) == [name]
    zero = replace(POLICY, **{name: 0.0})
    assert not zero.differences(replace(zero, **{name: 5e-10}))
    assert list(zero.differences(replace(zero, **{name: 5e-9}))) == [name]


@pytest.mark.parametrize("name", ["max_looks", "max_views"])
def test_one_is_the_fewest(name: str) -> None:
    content = POLICY.as_dict() | {name: 1}
    assert getattr(LookPolicy.from_dict(content), name) == 1
    for value in (0, -1, True, 1.0, None):
        with pytest.raises(ValueError, match=f"{name} is {value!r}, not 1 or more"):
            LookPolicy.from_dict(content | {name: value})


@pytest.mark.parametrize("name", ["guide", "views_from"])
def test_names_are_text(name: str) -> None:
    with pytest.raises(ValueError, match="does not hold what it should"):
        LookPolicy.from_dict({**POLICY.as_dict(), name: 1})


def test_the_parameters_that_mend_a_difference_are_named() -> None:
    other = LookPolicy("best", False, 2, 2, "all", 10.0, 0.002, 0.002, 0.03)
    with pytest.raises(MismatchError) as caught:
        check_policy(POLICY, other)
    assert caught.value.parameters == (
        "guide",
        "camera_poses",
        "max_looks",
        "views_from",
        "min_parallax",
        "camera_noise",
        "min_gain",
    )
