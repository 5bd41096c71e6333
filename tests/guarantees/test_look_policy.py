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
