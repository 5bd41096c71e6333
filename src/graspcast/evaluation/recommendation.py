"""Recommendation of a principal and its supporters, in words, from a comparison of estimators."""

from __future__ import annotations

from graspcast.evaluation.bootstrap import Interval
from graspcast.evaluation.estimator_comparison import Comparison, SupporterComparison
from graspcast.evaluation.paired_differences import CRITERION, PRINCIPAL_MEASURES
from graspcast.evaluation.view_worth import ViewWorth

__all__ = ["recommendation"]

_ATTEMPT_RATES = ("50", "70", "90", "100")
_ORDINAL = {2: "second", 3: "third"}
_WORTH = {2: ("a second view", "a second estimator")}


def recommendation(comparison: Comparison) -> str:
    """Return the recommended principal, how certain that is, and which supporters help.

    Without instances that were tried with every principal, none can be recommended.
    """
    if not comparison.common_scores:
        names = ", ".join(comparison.principals)
        return f"No principal can be recommended, since no instance was tried with all of {names}"
    best, *others = comparison.ranking
    scores = comparison.common_scores[best]
    rates = " / ".join(f"{scores[name]:.3f}" for name in PRINCIPAL_MEASURES[1:])
    parts = [
        f"Use {best} as principal: averaged over all attempt rates, {1 - scores[CRITERION]:.3f} of "
        f"its attempts succeed ({rates} with 50 / 70 / 90 / 100 % attempted)"
    ]
    if others:
        first = comparison.improvement[best, others[0]][CRITERION]
        parts[0] += f", {first:+} compared with the next best, {others[0]}"
        unclear = [
            name
            for name in others
            if not comparison.improvement[best, name][CRITERION].excludes_zero
        ]
        if unclear:
            parts.append(f"the difference from {' and '.join(unclear)} is not significant")
        parts += filter(None, (_where_better(comparison, name, best) for name in others))
    else:
        parts.append("no other principal has outcomes")
    parts += _supporters(comparison.principals[best], comparison.estimators)
    if best in comparison.views:
        parts += _further_views(comparison.views[best])
    return "; ".join(parts)


def _where_better(comparison: Comparison, other: str, best: str) -> str:
    """Return at which attempt rates another principal has a higher success rate, if at any."""
    mine, theirs = comparison.common_scores[best], comparison.common_scores[other]
    pairs = zip(_ATTEMPT_RATES, PRINCIPAL_MEASURES[1:], strict=True)
    higher = {rate: theirs[name] for rate, name in pairs if theirs[name] > mine[name]}
    values = " / ".join(f"{value:.3f}" for value in higher.values())
    if not higher:
        return ""
    return f"with {' / '.join(higher)} % attempted, {other} has a higher success rate ({values})"


def _supporters(found: SupporterComparison, estimators: tuple[str, ...]) -> list[str]:
    """Return which supporters improve the forecasts, which do not, and which impair them."""
    if not found.without:
        (only,) = (name for name in estimators if name != found.principal)
        return [f"{only} is its only supporter, without which there is no forecast"]
    by = {name: without.improvement[CRITERION] for name, without in found.without.items()}
    kinds = {
        "supporters that improve the forecasts": [n for n, gain in by.items() if gain.low > 0],
        "no significant improvement by": [n for n, gain in by.items() if not gain.excludes_zero],
        "supporters to leave out": [n for n, gain in by.items() if gain.high < 0],
    }
    return [
        f"{kind}: " + ", ".join(f"{name} ({by[name]:+})" for name in names)
        for kind, names in kinds.items()
        if names
    ]


def _further_views(found: ViewWorth) -> list[str]:
    """Return what further views are worth, beside further estimators and beside all of them."""
    out = []
    for views, gain in found.instead.items():
        interval = gain.improvement[CRITERION]
        which = _WORTH.get(views, (f"{views - 1} further views", f"{views - 1} further estimators"))
        names = " and ".join(gain.worse[0][1:])
        out.append(f"{_more(interval, *which)} ({names}): {interval:+}")
    for views, gain in found.further.items():
        interval, name = gain.improvement[CRITERION], _ORDINAL.get(views, f"{views}th")
        improves = "improves" if interval.low > 0 else "does not significantly improve"
        if interval.high < 0:
            improves = "impairs"
        out.append(f"with all estimators a {name} view {improves} the forecasts: {interval:+}")
    return out


def _more(interval: Interval, views: str, estimators: str) -> str:
    """Return which of two is worth more, where the interval says so."""
    if interval.low > 0:
        return f"{views} {_is(views)} worth more than {estimators}"
    if interval.high < 0:
        return f"{estimators} {_is(estimators)} worth more than {views}"
    return f"it is not decided whether {views} or {estimators} {_is(estimators)} worth more"


def _is(what: str) -> str:
    return "is" if what.startswith("a ") else "are"
