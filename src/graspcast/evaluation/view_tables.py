"""Forecasts with several views as Markdown: scores, policies, certificates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from graspcast.evaluation.report import SCORES
from graspcast.evaluation.tables import TITLES, with_interval
from graspcast.evaluation.view_scores import SINGLE, VIEWS
from graspcast.io.markdown import table

__all__ = ["render_views"]


def render_views(found: Mapping[str, Any]) -> str:
    """Return what :func:`graspcast.evaluation.view_report.evaluate_views` found as Markdown."""
    parts = ["## Several views"]
    for protocol, mine in found.items():
        parts += [f"### `{protocol}`", mine["description"]]
        grippers = list(next(iter(mine["scores"].values())))
        for gripper in grippers:
            parts += [_scores(mine["scores"], gripper), _differences(mine["scores"], gripper)]
        if mine.get("policies"):
            parts.append(
                f"Attempts from a probability of {mine['threshold']:g} on; below it, the policies "
                "that look again are judged with a further recorded view."
            )
            for guide, by_gripper in mine["policies"].items():
                parts += [_policies(guide, g, p) for g, p in by_gripper.items()]
        if mine.get("expectation"):
            parts += [
                "The forecast before a further look, as expected after it, and after it, guided by "
                "the fused pose:",
                _expectation(mine["expectation"]),
            ]
        if mine.get("certificates"):
            parts += [
                "Certified 0.9 with confidence 0.9 on a random half of the images, attempted on "
                "the other half:",
                _certificates(mine["certificates"]),
            ]
    return "\n\n".join(parts)


def _scores(scores: Mapping[str, Any], gripper: str) -> str:
    rows = []
    for name, by_gripper in scores.items():
        for method in (VIEWS, SINGLE):
            mine = by_gripper[gripper][method]
            title = name if method == VIEWS else f"{name}: the same from one view"
            cells = [with_interval(mine[m], mine[f"{m}_interval"]) for m in SCORES]
            rows.append([title, f"{by_gripper[gripper]['n']:.0f}", *cells])
    return table([f"{gripper} gripper", "n", *(TITLES[m] for m in SCORES)], rows)


def _differences(scores: Mapping[str, Any], gripper: str) -> str:
    rows = []
    for name, by_gripper in scores.items():
        mine = by_gripper[gripper][VIEWS]["differences"][SINGLE]
        cells = [with_interval(mine[m]["difference"], mine[m]["interval"], "+") for m in SCORES]
        rows.append([f"{name} minus one view", *cells])
    return table([f"{gripper} gripper", *(TITLES[m] for m in SCORES)], rows)


def _policies(guide: str, gripper: str, found: Mapping[str, Any]) -> str:
    names = ("attempts", "success", "looks")
    rows = [
        [policy, *(with_interval(mine[m], mine[f"{m}_interval"]) for m in names)]
        for policy, mine in found.items()
        if policy != "n"
    ]
    title = f"{gripper} gripper, guided by {guide} (n {found['n']:.0f})"
    return table([title, "attempted", "succeed", "looks"], rows)


def _expectation(entries: list[Mapping[str, Any]]) -> str:
    names = ("before", "expected", "after", "calibration", "correlation")
    rows = [
        [f"{e['gripper']}, after look {e['looks']}", str(e["n"]), *_cells(e, names)]
        for e in entries
    ]
    header = ["gripper", "n", "before", "expected", "after", "calibration error", "correlation"]
    return table(header, rows)


def _certificates(entries: list[Mapping[str, Any]]) -> str:
    names = ("none", "false", "attempted", "of_perfect", "success")
    rows = []
    for e in entries:
        views = "one view" if e["views"] == 1 else f"{e['views']} views"
        title = f"{e['gripper']}, {e['guide']}, {views}"
        rows.append([title, str(e["n"]), *_cells(e, names)])
    header = ["gripper, guide", "n", "no threshold", "false", "attempted", "of perfect", "succeed"]
    return table(header, rows)


def _cells(entry: Mapping[str, Any], names: Sequence[str]) -> list[str]:
    """Return numbers as text, a dash where there is none."""
    return [with_interval(entry[name], None) for name in names]
