"""The reproduced tables as Markdown: paper, ours, difference."""

from __future__ import annotations

from typing import Any

from graspcast.io.markdown import table
from graspcast.paper.configurations import CONFIGURATIONS, PROTOCOLS
from graspcast.paper.dataset import ESTIMATORS, GRIPPERS, OBJECTS
from graspcast.paper.tables import paper_tables

__all__ = ["render"]

_NONE = "-"
_NAMES = {"epos": "EPOS", "gdrnpp": "GDRNPP", "zebrapose": "ZebraPose", "average": "Average"}


def _triple(paper: float | None, ours: float | None, digits: int) -> list[str]:
    """Format the paper's figure, ours, and the difference."""
    if paper is None or ours is None:
        return [_NONE if v is None else f"{v:.{digits}f}" for v in (paper, ours)] + [_NONE]
    return [f"{paper:.{digits}f}", f"{ours:.{digits}f}", f"{ours - paper:+.{digits}f}"]


def _table1(ours: dict[str, Any], paper: dict[str, Any]) -> str:
    header = ["Object"]
    for estimator in ESTIMATORS:
        for gripper in GRIPPERS:
            header += [f"{_NAMES[estimator]} {gripper[:3]}. paper", "ours", "diff."]
    rows = []
    for name, title in OBJECTS.items():
        row = [title]
        for estimator in ESTIMATORS:
            for gripper in GRIPPERS:
                row += _triple(paper[name][estimator][gripper], ours[name][estimator][gripper], 3)
        rows.append(row)
    return table(header, rows)


def _table2(ours: dict[str, Any], paper: dict[str, Any]) -> str:
    digits = {"rotation_deg": 2, "translation_mm": 1, "parallel": 3, "underactuated": 3}
    rows = []
    for dataset, by_estimator in paper.items():
        for estimator, printed in by_estimator.items():
            row = [f"{dataset.upper()} {_NAMES[estimator]}"]
            for measure, places in digits.items():
                row += _triple(printed[measure], ours[dataset][estimator][measure], places)
            rows.append(row)
    header = ["Dataset, estimator"]
    for measure in ("rotation (deg)", "translation (mm)", "success par.", "success und."):
        header += [f"{measure} paper", "ours", "diff."]
    return table(header, rows)


def _table3(ours: dict[str, Any], paper: dict[str, Any]) -> str:
    header = ["Method"]
    for column in (*ESTIMATORS, "average"):
        for gripper in GRIPPERS:
            header += [f"{_NAMES[column]} {gripper[:3]}. paper", "ours", "diff."]
    rows = []
    for method, printed in paper.items():
        protocol = "fitted" if method == "baseline" else "paper"
        mine = ours[method][protocol]
        row = [f"{method} ({protocol})"]
        for column in (*ESTIMATORS, "average"):
            found = mine if column == "average" else mine["by_principal"][column]
            for gripper in GRIPPERS:
                row += _triple(printed[column][gripper], found[gripper], 3)
        rows.append(row)
    return table(header, rows)


def _by_protocol(found: dict[str, Any]) -> str:
    ours = found["table3"]
    rows = []
    for method in ("baseline", *CONFIGURATIONS):
        row = [method]
        for protocol in PROTOCOLS:
            mine = ours[method].get(protocol) or (
                ours[method]["fitted"] if method == "baseline" and protocol != "paper" else None
            )
            row += [f"{mine[g]:.3f}" if mine else _NONE for g in GRIPPERS]
        rows.append(row)
    majority = [f"{found['majority'][g]:.3f}" for g in GRIPPERS]
    rows.append(["majority", *[_NONE, _NONE], *majority, *majority])
    header = ["Method", *(f"{p} {g[:3]}." for p in PROTOCOLS for g in GRIPPERS)]
    return table(header, rows)


def _deviating(note: dict[str, Any]) -> str:
    if "deviating_cells" not in note:
        return "The baseline's ADD is computed from the object models in bop/."
    cells = note["deviating_cells"]
    lines = [
        "The baseline above uses the ADD differences that the authors released. With ADD from the "
        f"object models in bop/ it scores {note['meshes']['parallel']:.3f} / "
        f"{note['meshes']['underactuated']:.3f}; {len(cells)} cells deviate:"
    ]
    if cells:
        rows = [[name, f"{v['released']:.3f}", f"{v['meshes']:.3f}"] for name, v in cells.items()]
        lines += ["", table(["Principal/object/gripper", "released ADD", "our ADD"], rows)]
    return "\n".join(lines)


def render(found: dict[str, Any]) -> str:
    """Format the result of :func:`graspcast.paper.tables.reproduce` as a Markdown document."""
    paper = paper_tables()
    seeds = found["seeds"]
    return "\n\n".join(
        [
            "## Table I: grasp success rates",
            _table1(found["table1"], paper["table1"]),
            "## Table II: pose errors and success rates, averaged over objects",
            _table2(found["table2"], paper["table2"]),
            "## Table III: accuracy of success prediction, averaged over objects",
            f"Networks: mean of {seeds} seed{'s' if seeds > 1 else ''}, protocol `paper`: the "
            "checkpoint with the best accuracy on the test set (for each object where objects are "
            "pooled). This selection uses the test outcomes, so it is optimistic.",
            _table3(found["table3"], paper["table3"]),
            _deviating(found["baseline"]),
            "## Table III without selection on the test set",
            "Average over principals. `last`: after the final epoch; `validated`: trained without "
            "a fifth of the training set, the checkpoint with the lowest loss on it. The baseline "
            "and the majority guess have no checkpoints.",
            _by_protocol(found),
            f"Computed in {found['seconds']:.0f} s.",
        ]
    )
