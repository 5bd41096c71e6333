"""The recommendation, from hand-made comparisons."""

from __future__ import annotations

from collections.abc import Mapping

from graspcast.evaluation.bootstrap import Interval
from graspcast.evaluation.estimator_comparison import Comparison, SupporterComparison
from graspcast.evaluation.paired_differences import PairedDifference
from graspcast.evaluation.principal_views import Seen
from graspcast.evaluation.recommendation import recommendation
from graspcast.evaluation.view_worth import Gain, ViewWorth

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


def worth(instead: dict[int, Interval], further: dict[int, Interval]) -> ViewWorth:
    every: tuple[str, ...] = ("a", "b", "c")

    def gain(better: Seen, worse: Seen, interval: Interval) -> Gain:
        return Gain(better, worse, {"aurc": interval})

    return ViewWorth(
        "a", every, 100, 5, 0, {}, 0.6, {}, {},
        {v: gain(((every[0],), v), (every[:v], 1), each) for v, each in instead.items()},
        {v: gain((every, v), (every, v - 1), each) for v, each in further.items()},
        {},
    )  # fmt: skip


def with_views(found: ViewWorth) -> str:
    base = comparison({"a": {"aurc": 0.2, **RATES}}, BETTER, supporters("a", b=BETTER, c=UNCLEAR))
    single = recommendation(base)
    text = recommendation(Comparison(**{**vars(base), "views": {"a": found}}))
    assert text.startswith(f"{single}; ")
    return text.removeprefix(f"{single}; ")


def test_views_that_are_worth_more_than_estimators() -> None:
    assert with_views(worth({2: BETTER, 3: BETTER}, {2: BETTER, 3: UNCLEAR})) == (
        "a second view is worth more than a second estimator (b): +0.020 [+0.010, +0.030]; 2 "
        "further views are worth more than 2 further estimators (b and c): +0.020 [+0.010, "
        "+0.030]; with all estimators a second view improves the forecasts: +0.020 [+0.010, "
        "+0.030]; with all estimators a third view does not significantly improve the forecasts: "
        "+0.004 [-0.010, +0.020]"
    )


def test_what_the_interval_does_not_decide_is_not_claimed() -> None:
    said = with_views(worth({2: UNCLEAR}, {2: WORSE}))
    assert "it is not decided whether a second view or a second estimator is worth more (b)" in said
    assert "is worth more than" not in said
    assert "a second view impairs the forecasts: -0.020" in said
    said = with_views(worth({2: WORSE}, {}))
    assert said.startswith("a second estimator is worth more than a second view (b): -0.020")


def test_an_undefined_interval_decides_nothing() -> None:
    """As with a single scene."""
    nothing = Interval(0.1, float("nan"), float("nan"))
    assert "worth more than" not in with_views(worth({2: nothing}, {2: nothing}))
