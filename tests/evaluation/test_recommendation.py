"""The recommendation, from hand-made comparisons."""

from __future__ import annotations

from collections.abc import Mapping

from graspcast.evaluation.bootstrap import Interval
from graspcast.evaluation.estimator_comparison import Comparison, SupporterComparison
from graspcast.evaluation.paired_differences import PairedDifference
from graspcast.evaluation.recommendation import recommendation

BETTER, WORSE = Interval(0.02, 0.01, 0.03), Interval(-0.02, -0.03, -0.01)
UNCLEAR = Interval(0.004, -0.01, 0.02)
RATES = {"success_at_50": 0.9, "success_at_70": 0.8, "success_at_90": 0.7, "success": 0.6}


def supporters(principal: str, **without: Interval) -> SupporterComparison:
    found = {name: PairedDifference({}, {"aurc": each}) for name, each in without.items()}
    return SupporterComparison(principal, 100, 0, 5, 0.6, {}, found, {})


def comparison(
    scores: Mapping[str, Mapping[str, float]], lead: Interval, *found: SupporterComparison
) -> Comparison:
    improvement = {(one, other): {"aurc": lead} for one in scores for other in scores}
    by_name = {each.principal: each for each in found}
    return Comparison("p", ("a", "b", "c"), by_name, 100, 5, scores, improvement, {})


def test_principal_and_supporters() -> None:
    scores = {"b": {"aurc": 0.3, **RATES}, "a": {"aurc": 0.2, **RATES, "success": 0.5}}
    found = comparison(scores, BETTER, supporters("a", b=BETTER, c=UNCLEAR), supporters("b"))
    assert recommendation(found) == (
        "Use a as principal: averaged over all attempt rates, 0.800 of its attempts succeed "
        "(0.900 / 0.800 / 0.700 / 0.500 with 50 / 70 / 90 / 100 % attempted), +0.020 [+0.010, "
        "+0.030] compared with the next best, b; with 100 % attempted, b has a higher success rate "
        "(0.600); supporters that improve the forecasts: b (+0.020 [+0.010, +0.030]); no "
        "significant improvement by: c (+0.004 [-0.010, +0.020])"
    )


def test_an_unclear_lead_and_a_harmful_supporter() -> None:
    scores = {"a": {"aurc": 0.2, **RATES}, "b": {"aurc": 0.3, **RATES}}
    found = recommendation(comparison(scores, UNCLEAR, supporters("a", b=UNCLEAR, c=WORSE)))
    assert "the difference from b is not significant" in found
    assert "higher success rate" not in found
    assert "supporters to leave out: c (-0.020" in found


def test_a_single_principal_with_a_single_supporter() -> None:
    found = comparison({"a": {"aurc": 0.2, **RATES}}, BETTER, supporters("a"))
    text = recommendation(Comparison(**{**vars(found), "estimators": ("a", "b")}))
    assert "no other principal has outcomes" in text
    assert text.endswith("b is its only supporter, without which there is no forecast")


def test_without_common_instances_nothing_is_recommended() -> None:
    found = comparison({}, BETTER, supporters("a"), supporters("b"))
    assert "no instance was tried with all of a, b" in recommendation(found)
