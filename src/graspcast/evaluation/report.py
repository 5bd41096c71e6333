"""Evaluation of predictions: scores with intervals, paired differences, and net benefit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.evaluation.bootstrap import Bootstrap, Interval, ResampledScores, draw_scenes
from graspcast.evaluation.net_benefit import Costs
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.scores import score
from graspcast.io.progress import Progress

__all__ = ["BASELINES", "MEASURES", "SCORES", "evaluate", "evaluate_protocol"]

SCORES = ("accuracy", "auroc", "brier", "ece", "aurc")
MEASURES = (*SCORES, "net_benefit")
BASELINES = ("threshold", "MLP", "MLP-O")
"""The methods that all others are compared with, if they were evaluated too."""

_NO_LIMITS = (-np.inf, np.inf)
_LIMITS = {**dict.fromkeys(SCORES, (0.0, 1.0)), "net_benefit": _NO_LIMITS}

Draws = dict[str, Float[ndarray, " draws"]]
"""Measure's name to its value in each draw."""


@dataclass(frozen=True, eq=False)
class _PrincipalScores:
    """The scores of one method for one principal and gripper, and those of the draws."""

    measures: dict[str, float]
    scores: dict[str, Any]
    draws: Draws


def evaluate(
    forecasts: Sequence[Forecasts],
    *,
    costs: Costs | None = None,
    bootstrap: Bootstrap | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Score every method with every gripper under every protocol, averaged over principals.

    Parameters
    ----------
    forecasts
        Predictions. All methods need the same rows for a protocol, principal and gripper, and the
        same principals for a protocol and gripper.
    costs
        Of failures and of abstaining.
    bootstrap
        Settings of the intervals.
    progress
        Called with the share of protocols that are done, from 0 to 1, and a short message.

    Returns
    -------
        ``evaluate.<protocol>.<method>.<gripper>`` with each of :data:`MEASURES` as a number,
        ``<measure>_interval``, ``differences.<baseline>.<measure>`` (``difference`` and
        ``interval``, the method's minus the baseline's) and ``by_principal``; and
        ``reference_net_benefit.<protocol>.<gripper>``: the net benefit of attempting always, never,
        and by perfect forecasts.

    Raises
    ------
    InputError
        If there are no forecasts, or two of the same.
    MismatchError
        If methods were evaluated on different rows.
    """
    if not forecasts:
        raise InputError("there are no forecasts to evaluate")
    costs, bootstrap = costs or Costs(), bootstrap or Bootstrap()
    found: dict[str, Any] = {"evaluate": {}, "reference_net_benefit": {}}
    protocols = list(dict.fromkeys(f.protocol for f in forecasts))
    for i, protocol in enumerate(protocols):
        if progress is not None:
            progress(i / len(protocols), f"scores of {protocol.replace('_', ' ')}")
        mine = [f for f in forecasts if f.protocol == protocol]
        scores, references = evaluate_protocol(mine, costs, bootstrap)
        found["evaluate"][protocol] = scores
        found["reference_net_benefit"][protocol] = references
    if progress is not None:
        progress(1.0, "scores")
    return found


def evaluate_protocol(
    forecasts: Sequence[Forecasts],
    costs: Costs,
    bootstrap: Bootstrap,
    *,
    baselines: Sequence[str] = BASELINES,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return scores by method and gripper, and reference net benefits by gripper, of one protocol.

    All methods, principals and grippers share the draws of scenes, so differences from the
    baselines are paired.
    """
    given = _check(forecasts)
    scenes = np.unique(np.concatenate([f.scenes for f in forecasts])).tolist()
    counts = draw_scenes(scenes, bootstrap.draws, bootstrap.seed)
    scored = {key: _score(f, scenes, counts, costs) for key, f in given.items()}
    out: dict[str, Any] = {method: {} for method, _, _ in given}
    references = {}
    for gripper in dict.fromkeys(gripper for _, _, gripper in given):
        by_method: dict[str, dict[str, _PrincipalScores]] = {}
        for (method, principal, g), found in scored.items():
            if g == gripper:
                by_method.setdefault(method, {})[principal] = found
        for method, found in _of_gripper(by_method, bootstrap, baselines).items():
            out[method][gripper] = found
        first = next(iter(by_method))
        references[gripper] = _references(
            [f for (m, _, g), f in given.items() if (m, g) == (first, gripper)], costs
        )
    return out, references


def _of_gripper(
    by_method: Mapping[str, Mapping[str, _PrincipalScores]],
    bootstrap: Bootstrap,
    baselines: Sequence[str],
) -> dict[str, Any]:
    """Return each method's scores with one gripper, averaged over principals."""
    draws = {m: _mean_draws(found) for m, found in by_method.items()}
    means = {m: _mean(found) for m, found in by_method.items()}

    def ends(value: float, drawn: ndarray, limits: tuple[float, float]) -> list[float] | None:
        return Interval.of(value, drawn, limits, confidence=bootstrap.confidence).ends

    def differences(method: str, baseline: str) -> dict[str, Any]:
        out = {}
        for k in MEASURES:
            difference = means[method][k] - means[baseline][k]
            interval = ends(difference, draws[method][k] - draws[baseline][k], _NO_LIMITS)
            out[k] = {"difference": _number(difference), "interval": interval}
        return out

    return {
        method: {
            **{k: _number(v) for k, v in means[method].items()},
            **{
                f"{k}_interval": ends(means[method][k], drawn, _LIMITS[k])
                for k, drawn in draws[method].items()
            },
            "differences": {
                baseline: differences(method, baseline)
                for baseline in baselines
                if baseline in draws and baseline != method
            },
            "by_principal": {principal: one.scores for principal, one in found.items()},
        }
        for method, found in by_method.items()
    }


def _references(forecasts: Sequence[Forecasts], costs: Costs) -> dict[str, float]:
    """Return the reference net benefits, averaged over principals."""
    values = [costs.references(f.success) for f in forecasts]
    return {name: float(np.mean([v[name].mean() for v in values])) for name in values[0]}


def _check(forecasts: Sequence[Forecasts]) -> dict[tuple[str, str, str], Forecasts]:
    """Return forecasts by method, principal and gripper; all methods must have the same rows."""
    given: dict[tuple[str, str, str], Forecasts] = {}
    first: dict[tuple[str, str], Forecasts] = {}
    principals: dict[tuple[str, str], set[str]] = {}
    for f in forecasts:
        key = (f.method, f.principal, f.gripper)
        if key in given:
            raise InputError(f"two forecasts of {', '.join(key)} in {f.protocol}")
        given[key] = f
        principals.setdefault((f.method, f.gripper), set()).add(f.principal)
        other = first.setdefault((f.principal, f.gripper), f)
        for name in ("success", "objects", "scenes"):
            if not np.array_equal(getattr(f, name), getattr(other, name)):
                raise MismatchError(
                    f"{f.method} and {other.method} were evaluated on different {name} in "
                    f"{f.protocol} ({f.principal}, {f.gripper}), so they cannot be compared"
                )
    for gripper in {g for _, g in principals}:
        sets = {m: names for (m, g), names in principals.items() if g == gripper}
        every = set().union(*sets.values())
        for method, names in sets.items():
            if names != every:
                raise MismatchError(
                    f"{method} has no forecasts for {', '.join(sorted(every - names))} "
                    f"({forecasts[0].protocol}, {gripper}), but another method has"
                )
    return given


def _score(
    f: Forecasts, scenes: Sequence[str], counts: Int[ndarray, "draws scenes"], costs: Costs
) -> _PrincipalScores:
    benefit = costs.net_benefit_of_forecast(f.probability, f.success)
    attempts = f.probability >= costs.break_even
    found = score(f.probability, f.success, f.objects)
    resampled = ResampledScores(f, scenes, counts)
    draws = {name: getattr(resampled, name)() for name in SCORES}
    mean = float(benefit.mean())
    return _PrincipalScores(
        measures={**{name: getattr(found, name) for name in SCORES}, "net_benefit": mean},
        scores={
            **found.as_dict(),
            "net_benefit": mean,
            "attempt_rate": float(attempts.mean()),
        },
        draws={**draws, "net_benefit": resampled.mean(benefit)},
    )


def _mean(by_principal: Mapping[str, _PrincipalScores]) -> dict[str, float]:
    return {k: float(np.mean([p.measures[k] for p in by_principal.values()])) for k in MEASURES}


def _mean_draws(by_principal: Mapping[str, _PrincipalScores]) -> Draws:
    return {k: np.mean([p.draws[k] for p in by_principal.values()], axis=0) for k in MEASURES}


def _number(value: float) -> float | None:
    """Return None for NaN, which JSON does not have."""
    return None if np.isnan(value) else value
