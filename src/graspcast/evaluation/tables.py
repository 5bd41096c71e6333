"""The evaluation as Markdown: for each protocol scores, paired differences and net benefit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from graspcast.evaluation.report import BASELINES, SCORES
from graspcast.io.markdown import table

__all__ = ["TITLES", "render_evaluation", "with_interval"]

_NONE = "-"
TITLES: Mapping[str, str] = {
    "accuracy": "accuracy",
    "auroc": "AUROC",
    "brier": "Brier",
    "ece": "ECE",
    "aurc": "AURC",
    "net_benefit": "net benefit",
}
"""Each measure's name in tables."""
_REFERENCES = {
    "always": "attempt all",
    "never": "attempt none",
    "perfect": "perfect forecasts",
}


def render_evaluation(found: Mapping[str, Any]) -> str:
    """Return the JSON content of ``graspcast evaluate`` as a Markdown document."""
    bootstrap, costs = found["bootstrap"], found["costs"]
    parts = [
        f"Means over principals; in brackets {100 * bootstrap['confidence']:.0f} % confidence "
        f"intervals of {bootstrap['draws']} bootstrap draws of scenes (bias-corrected percentiles; "
        "all methods share the draws, so differences are paired). Accuracy is at a probability of "
        "0.5, averaged over objects; for Brier, ECE and AURC lower is better. Net benefit is per "
        f"instance, in units of the gain of a success; a failure costs {costs['failure']:g} and "
        f"abstaining {costs['abstention']:g}, so attempts are made from a probability of "
        f"{costs['break_even']:.3f} on.",
        "\n".join(f"- `{name}`: {text}" for name, text in found["methods"].items()),
    ]
    for protocol, scores in found["evaluate"].items():
        references = found["reference_net_benefit"][protocol]
        parts += [f"## `{protocol}`", found["protocols"][protocol]]
        parts += [_scores(scores, gripper) for gripper in references]
        differences = [_differences(scores, gripper) for gripper in references]
        if any(differences):
            names = [b for b in BASELINES if b in scores]
            parts += [f"Paired differences from {', '.join(names)}:", *filter(None, differences)]
        parts.append(_net_benefit(scores, references))
    return "\n\n".join(parts)


def with_interval(value: float | None, interval: list[float] | None, sign: str = "") -> str:
    """Format a value and its interval, with signs if ``sign`` is ``+``."""
    if value is None:
        return _NONE
    text = f"{value:{sign}.3f}"
    return text if interval is None else f"{text} [{', '.join(f'{v:{sign}.3f}' for v in interval)}]"


def _scores(scores: Mapping[str, Any], gripper: str) -> str:
    rows = [
        [method, *(with_interval(f[gripper][m], f[gripper][f"{m}_interval"]) for m in SCORES)]
        for method, f in scores.items()
        if gripper in f
    ]
    return table([f"{gripper} gripper", *(TITLES[m] for m in SCORES)], rows)


def _differences(scores: Mapping[str, Any], gripper: str) -> str:
    shown = ("accuracy", "auroc", "brier", "net_benefit")
    rows = []
    for method, f in scores.items():
        if gripper not in f:
            continue
        for baseline, by_measure in f[gripper]["differences"].items():
            cells = [by_measure[m] for m in shown]
            rows.append(
                [
                    f"{method} minus {baseline}",
                    *(with_interval(c["difference"], c["interval"], "+") for c in cells),
                ]
            )
    return table([f"{gripper} gripper", *(TITLES[m] for m in shown)], rows) if rows else ""


def _net_benefit(scores: Mapping[str, Any], references: Mapping[str, Any]) -> str:
    rows = [
        [title, *(f"{r[name]:.3f}" for r in references.values())]
        for name, title in _REFERENCES.items()
    ]
    for method, f in scores.items():
        cells = [f.get(gripper) for gripper in references]
        rows.append(
            [
                method,
                *(
                    with_interval(c["net_benefit"], c["net_benefit_interval"]) if c else _NONE
                    for c in cells
                ),
            ]
        )
    return table(["net benefit per instance", *references], rows)
