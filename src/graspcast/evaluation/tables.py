"""The evaluation as Markdown: for each protocol what it means, scores, differences, net value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from graspcast.evaluation.report import BASELINES, SCORES
from graspcast.io.markdown import table

__all__ = ["render_evaluation"]

_NONE = "-"
_TITLES = {
    "accuracy": "accuracy",
    "auroc": "AUROC",
    "brier": "Brier",
    "ece": "ECE",
    "aurc": "AURC",
    "net_value": "net value",
}


def _with_interval(value: float | None, interval: list[float] | None, sign: str = "") -> str:
    if value is None:
        return _NONE
    text = f"{value:{sign}.3f}"
    return text if interval is None else f"{text} [{', '.join(f'{v:{sign}.3f}' for v in interval)}]"


def _scores(figures: Mapping[str, Any], gripper: str) -> str:
    rows = [
        [method, *(_with_interval(f[gripper][m], f[gripper][f"{m}_interval"]) for m in SCORES)]
        for method, f in figures.items()
        if gripper in f
    ]
    return table([f"{gripper} gripper", *(_TITLES[m] for m in SCORES)], rows)


def _differences(figures: Mapping[str, Any], gripper: str) -> str:
    shown = ("accuracy", "auroc", "brier", "net_value")
    rows = []
    for method, f in figures.items():
        if gripper not in f:
            continue
        for baseline, by_measure in f[gripper]["differences"].items():
            cells = [by_measure[m] for m in shown]
            rows.append(
                [
                    f"{method} minus {baseline}",
                    *(_with_interval(c["difference"], c["interval"], "+") for c in cells),
                ]
            )
    return table([f"{gripper} gripper", *(_TITLES[m] for m in shown)], rows) if rows else ""


def _values(figures: Mapping[str, Any], references: Mapping[str, Any]) -> str:
    rows = [[name, *(f"{r[name]:.3f}" for r in references.values())] for name in _REFERENCES]
    for method, f in figures.items():
        cells = [f.get(g) for g in references]
        rows.append(
            [
                f"following {method}",
                *(
                    _with_interval(c["net_value"], c["net_value_interval"]) if c else _NONE
                    for c in cells
                ),
            ]
        )
    rows = [[_REFERENCES.get(row[0], row[0]), *row[1:]] for row in rows]
    return table(["net value an instance", *references], rows)


_REFERENCES = {
    "always": "always attempting",
    "never": "never attempting",
    "perfect": "a perfect forecaster",
}


def render_evaluation(found: Mapping[str, Any]) -> str:
    """What ``graspcast evaluate`` writes as JSON, as a Markdown document."""
    bootstrap, costs = found["bootstrap"], found["costs"]
    parts = [
        f"Means over principals; in brackets {100 * bootstrap['confidence']:.0f} % intervals of "
        f"{bootstrap['draws']} bootstrap draws of whole scenes (percentiles, less the draws' "
        "bias; one draw for all methods, so differences are paired). Accuracy is at a probability "
        "of 0.5, averaged over objects; Brier, ECE and AURC are better if small. Net value "
        "is per instance, in units of what a success gains, a failure costing "
        f"{costs['failure']:g} and abstaining "
        f"{costs['abstention']:g}: attempts are made from a probability of "
        f"{costs['break_even']:.3f} on.",
        "\n".join(f"- `{name}`: {text}" for name, text in found["methods"].items()),
    ]
    for protocol, figures in found["evaluate"].items():
        references = found["reference_values"][protocol]
        parts += [f"## `{protocol}`", found["protocols"][protocol]]
        parts += [_scores(figures, gripper) for gripper in references]
        differences = [_differences(figures, gripper) for gripper in references]
        if any(differences):
            names = [b for b in BASELINES if b in figures]
            parts += [f"Paired differences against {', '.join(names)}:", *filter(None, differences)]
        parts.append(_values(figures, references))
    return "\n\n".join(parts)
