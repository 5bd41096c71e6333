"""From predictions to figures: scores with intervals, paired differences, and net value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.evaluation.bootstrap import Resampled, draw_scenes
from graspcast.evaluation.net_benefit import Costs
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.scores import score

__all__ = ["BASELINES", "MEASURES", "SCORES", "Bootstrap", "evaluate", "evaluate_protocol"]

SCORES = ("accuracy", "auroc", "brier", "ece", "aurc")
MEASURES = (*SCORES, "net_value")
BASELINES = ("threshold", "MLP", "MLP-O")
"""What every method is compared with, where it was evaluated too."""

_LIMITS = {**dict.fromkeys(SCORES, (0.0, 1.0)), "net_value": (-np.inf, np.inf)}

Draws = dict[str, Float[ndarray, " draws"]]
"""A measure's name to its value in each draw."""


@dataclass(frozen=True)
class Bootstrap:
    """How intervals are made: percentiles over draws of whole scenes, less the draws' bias.

    A draw repeats some scenes and lacks others, which alone makes the calibration error larger.
    What the draws exceed the estimate by on average is therefore taken off them (Efron & Tibshirani
    1993, chapter 10).

    Attributes
    ----------
    draws
        How often scenes are drawn.
    seed
        Of the draws.
    confidence
        Of the intervals.
    """

    draws: int = 1000
    seed: int = 0
    confidence: float = 0.95

    def interval(
        self,
        values: Float[ndarray, " draws"],
        estimate: float,
        limits: tuple[float, float] = (-np.inf, np.inf),
    ) -> list[float] | None:
        """Lower and upper end, within limits; None if neither draws nor the estimate have values.

        Parameters
        ----------
        values
            In each draw.
        estimate
            On the samples themselves.
        limits
            What the values cannot exceed.
        """
        defined = values[~np.isnan(values)]
        if not len(defined) or np.isnan(estimate):
            return None
        tail = (1 - self.confidence) / 2
        ends = np.quantile(defined, [tail, 1 - tail]) - (defined.mean() - estimate)
        return [float(v) for v in np.clip(ends, *limits)]


@dataclass(frozen=True, eq=False)
class _Cell:
    """One principal's share of a method's figures: on all rows, and in each draw."""

    measures: dict[str, float]
    scores: dict[str, Any]
    draws: Draws


def evaluate(
    forecasts: Sequence[Forecasts],
    *,
    costs: Costs | None = None,
    bootstrap: Bootstrap | None = None,
) -> dict[str, Any]:
    """Figures of every protocol, method and gripper, averaged over principals.

    Parameters
    ----------
    forecasts
        Predictions. All methods need the same rows for a protocol, principal and gripper, and the
        same principals for a protocol and gripper.
    costs
        Of failures and of abstaining.
    bootstrap
        How intervals are made.

    Returns
    -------
        ``evaluate.<protocol>.<method>.<gripper>`` with each of :data:`MEASURES` as a number,
        ``<measure>_interval``, ``differences.<baseline>.<measure>`` (``difference`` and
        ``interval``, the method's minus the baseline's) and ``by_principal``; and
        ``reference_values.<protocol>.<gripper>``: the net value of attempting always, never, and by
        a perfect forecaster.

    Raises
    ------
    InputError
        If there are no forecasts, or two of the same.
    MismatchError
        If methods were judged on different rows.
    """
    if not forecasts:
        raise InputError("there are no forecasts to evaluate")
    costs, bootstrap = costs or Costs(), bootstrap or Bootstrap()
    found: dict[str, Any] = {"evaluate": {}, "reference_values": {}}
    for protocol in dict.fromkeys(f.protocol for f in forecasts):
        mine = [f for f in forecasts if f.protocol == protocol]
        figures, references = evaluate_protocol(mine, costs, bootstrap)
        found["evaluate"][protocol] = figures
        found["reference_values"][protocol] = references
    return found


def evaluate_protocol(
    forecasts: Sequence[Forecasts], costs: Costs, bootstrap: Bootstrap
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Figures by method and gripper, and reference values by gripper, of one protocol.

    One draw of scenes serves all methods, principals and grippers, so differences are paired.
    """
    cells = _check(forecasts)
    scenes = np.unique(np.concatenate([f.scenes for f in forecasts])).tolist()
    counts = draw_scenes(scenes, bootstrap.draws, bootstrap.seed)
    scored = {key: _score(f, scenes, counts, costs) for key, f in cells.items()}
    methods = list(dict.fromkeys(method for method, _, _ in cells))
    grippers = list(dict.fromkeys(gripper for _, _, gripper in cells))
    figures: dict[str, Any] = {method: {} for method in methods}
    references = {}
    for gripper in grippers:
        by_method = {
            m: {p: cell for (n, p, g), cell in scored.items() if (n, g) == (m, gripper)}
            for m in methods
        }
        draws = {m: _mean_draws(by_method[m]) for m in methods if by_method[m]}
        means = {m: _mean(by_method[m]) for m in draws}
        for method in draws:
            figures[method][gripper] = {
                **{k: _number(v) for k, v in means[method].items()},
                **{
                    f"{k}_interval": bootstrap.interval(v, means[method][k], _LIMITS[k])
                    for k, v in draws[method].items()
                },
                "differences": {
                    baseline: _difference(means, draws, method, baseline, bootstrap)
                    for baseline in BASELINES
                    if baseline in draws and baseline != method
                },
                "by_principal": {p: cell.scores for p, cell in by_method[method].items()},
            }
        one = [f for (m, _, g), f in cells.items() if (m, g) == (next(iter(draws)), gripper)]
        values = [costs.references(f.success) for f in one]
        references[gripper] = {
            name: float(np.mean([v[name].mean() for v in values])) for name in values[0]
        }
    return figures, references


def _check(forecasts: Sequence[Forecasts]) -> dict[tuple[str, str, str], Forecasts]:
    """The forecasts by method, principal and gripper, all methods having been judged alike."""
    cells: dict[tuple[str, str, str], Forecasts] = {}
    first: dict[tuple[str, str], Forecasts] = {}
    principals: dict[tuple[str, str], set[str]] = {}
    for f in forecasts:
        key = (f.method, f.principal, f.gripper)
        if key in cells:
            raise InputError(f"two forecasts of {', '.join(key)} in {f.protocol}")
        cells[key] = f
        principals.setdefault((f.method, f.gripper), set()).add(f.principal)
        other = first.setdefault((f.principal, f.gripper), f)
        for name in ("success", "objects", "scenes"):
            if not np.array_equal(getattr(f, name), getattr(other, name)):
                raise MismatchError(
                    f"{f.method} and {other.method} were judged on different {name} in "
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
    return cells


def _score(
    f: Forecasts, scenes: Sequence[str], counts: Int[ndarray, "draws scenes"], costs: Costs
) -> _Cell:
    value = costs.following(f.probability, f.success)
    attempts = f.probability >= costs.break_even
    found = score(f.probability, f.success, f.objects)
    again = Resampled(f, scenes, counts)
    draws = {name: getattr(again, name)() for name in SCORES}
    net = float(value.mean())
    return _Cell(
        measures={**{name: getattr(found, name) for name in SCORES}, "net_value": net},
        scores={**found.as_dict(), "net_value": net, "attempt_rate": float(attempts.mean())},
        draws={**draws, "net_value": again.mean(value)},
    )


def _mean(cells: Mapping[str, _Cell]) -> dict[str, float]:
    return {k: float(np.mean([c.measures[k] for c in cells.values()])) for k in MEASURES}


def _mean_draws(cells: Mapping[str, _Cell]) -> Draws:
    return {k: np.mean([c.draws[k] for c in cells.values()], axis=0) for k in MEASURES}


def _number(value: float) -> float | None:
    """NaN is no JSON."""
    return None if np.isnan(value) else value


def _difference(
    means: Mapping[str, Mapping[str, float]],
    draws: Mapping[str, Draws],
    method: str,
    baseline: str,
    bootstrap: Bootstrap,
) -> dict[str, Any]:
    out = {}
    for k in MEASURES:
        difference = means[method][k] - means[baseline][k]
        interval = bootstrap.interval(draws[method][k] - draws[baseline][k], difference)
        out[k] = {"difference": _number(difference), "interval": interval}
    return out
