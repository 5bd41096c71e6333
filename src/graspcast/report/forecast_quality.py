"""Quality of the forecasts: risk-coverage with threshold and certificates, and reliability."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import polars as pl

from graspcast.evaluation.bootstrap import ResampledScores, draw_scenes
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.scores import BINS, bin_of, risk_coverage, score
from graspcast.guarantees.certificate import Certificate
from graspcast.report.content import Cell, Figure, Section, Table
from graspcast.report.decisions import Decisions
from graspcast.report.line_chart import Curve, Mark, curves_chart, diagonal_chart
from graspcast.report.rates import DRAWS

__all__ = ["after", "forecast_section"]

_COVERAGES = np.linspace(0.01, 1.0, 100)
_LEAST = 5
_FEWEST = 10
_WORDS = {1: "one look", 2: "two looks", 3: "three looks", 4: "four looks"}


def after(look: int, of: int) -> str:
    """Return words for a number of looks; nothing where one is all there is."""
    words = _WORDS.get(look, f"{look} looks")
    return f"after {'up to ' if look > 1 else ''}{words}" if of > 1 else "all verdicts"


def forecast_section(decisions: Decisions, certificates: Iterable[Certificate]) -> Section:
    """Return the section of risk-coverage, reliability and scores; empty without outcomes."""
    looks = [
        (look, known)
        for look in range(1, decisions.most_looks + 1)
        if len(known := decisions.at(look).drop_nulls(["success", "probability"]))
    ]
    title = "How far the probabilities can be trusted"
    if not looks:
        return Section("forecasts", title)
    return Section(
        key="forecasts",
        title=title,
        paragraphs=(
            "Attempting grasps from the most to the least probable, how many of the attempts fail? "
            "And of the grasps with one probability, does that share succeed?",
        ),
        figures=(
            _risk(decisions, looks, tuple(certificates)),
            *(_reliability(look, table, decisions.most_looks) for look, table in looks),
        ),
        tables=(_scores(looks, decisions.most_looks),),
    )


def _risk(
    decisions: Decisions,
    looks: Sequence[tuple[int, pl.DataFrame]],
    certificates: Sequence[Certificate],
) -> Figure:
    curves, marks = [], []
    rows: list[tuple[object, ...]] = []
    for number, (look, table) in enumerate(looks):
        name = after(look, decisions.most_looks)
        found = risk_coverage(table["probability"].to_numpy(), table["success"].to_numpy() == 1)
        # Instances without a forecast are never attempted.
        share = len(table) / len(decisions.at(look).drop_nulls("success"))
        least = min(_LEAST, len(table))
        picked = np.unique(np.maximum(least, np.rint(_COVERAGES * len(table))).astype(int)) - 1
        points = tuple((float(share * found.coverage[k]), float(found.risk[k])) for k in picked)
        curves.append(Curve(name, points))
        rows += [("curve", name, x, y) for x, y in points]
        tried = table.filter("attempt")
        if len(tried):
            place = share * len(tried) / len(table), 1.0 - float(tried["success"].mean())  # type: ignore[arg-type]
            marks.append(Mark(_threshold_words(decisions), *place, number))
            rows.append(("threshold", name, *place))
    marks += _certified(certificates, looks[-1][1], len(looks) - 1)
    rows += [("certificate", mark.name, mark.x, mark.y) for mark in marks if mark.shape != "dot"]
    rows += [("guaranteed", mark.name, mark.x, mark.y) for mark in marks if mark.x is None]
    highest = max([*(y for c in curves for _, y in c.points), *(m.y for m in marks), 0.05])
    told = "; ".join(f"{c.name}: {c.points[-1][1]:.2f} of all fail" for c in curves)
    return Figure(
        key="risk-coverage",
        title="Failure rate of attempts by the share attempted",
        caption="The lower, the better: grasps are attempted from the most probable on. A mark is "
        "what the verdicts attempted"
        + (", a diamond a certified threshold." if certificates else "."),
        svg=curves_chart(
            f"Failure rate by the share attempted. {told}",
            "share attempted",
            "share of attempts that fail",
            curves,
            marks,
            y_most=min(1.0, np.ceil(highest * 10) / 10),
        ),
        columns=("what", "name", "share_attempted", "failure_rate"),
        rows=tuple(rows),
    )


def _threshold_words(decisions: Decisions) -> str:
    threshold = decisions.threshold
    return "the verdicts" if threshold is None else f"the verdicts, threshold {threshold:g}"


def _certified(certificates: Sequence[Certificate], table: pl.DataFrame, curve: int) -> list[Mark]:
    """Return marks of the overall guarantees, on the curve of the last look."""
    marks = []
    for certificate in certificates:
        guarantee = certificate.overall
        if guarantee.threshold is None:
            continue
        tried = table.filter(pl.col("probability") >= guarantee.threshold)
        told = f"certified {guarantee.rate:g} (confidence {guarantee.confidence:g})"
        marks.append(Mark(f"failure rate of at most {1 - guarantee.rate:.3g}, {told}", None,
                          1.0 - guarantee.rate))  # fmt: skip
        if len(tried):
            x, y = len(tried) / len(table), 1.0 - float(tried["success"].mean())  # type: ignore[arg-type]
            name = f"threshold {guarantee.threshold:.3g}, {told}"
            marks.append(Mark(name, x, y, curve, "diamond"))
    return marks


def _reliability(look: int, table: pl.DataFrame, of: int) -> Figure:
    probability = table["probability"].to_numpy()
    success = table["success"].to_numpy() == 1
    number = bin_of(probability)
    size = np.bincount(number, minlength=BINS)
    mean = np.bincount(number, weights=probability, minlength=BINS)
    held = np.bincount(number, weights=success, minlength=BINS)
    low, high = _ends(table, probability, success)
    points, rows = [], []
    for k in np.flatnonzero(size):
        x, y = float(mean[k] / size[k]), float(held[k] / size[k])
        rows.append((k / BINS, (k + 1) / BINS, int(size[k]), x, y, float(low[k]), float(high[k])))
        if size[k] >= min(_FEWEST, size.max()):
            points.append((x, y, float(low[k]), float(high[k]), int(size[k])))
    words = after(look, of)
    return Figure(
        key=f"reliability-{look}",
        title=f"Reliability, {words}",
        caption=f"Each dot is the grasps of one of {BINS} bins of probability, {_FEWEST} or more; "
        "on the dashed line forecasts are right. Lines are 95 % intervals by drawing scenes.",
        svg=diagonal_chart(
            f"Success rate by forecast probability, {words}",
            "forecast probability",
            "share that succeeds",
            points,
        ),
        columns=("from", "to", "grasps", "mean_probability", "success_rate", "low", "high"),
        rows=tuple(rows),
    )


def _ends(
    table: pl.DataFrame, probability: np.ndarray, success: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of the intervals of each bin's success rate; NaN where there are none."""
    scenes = table["scene"].unique().sort().to_list()
    if len(scenes) < 2:
        return np.full(BINS, np.nan), np.full(BINS, np.nan)
    forecasts = Forecasts(
        *("report", "verdicts", "all", "all"),
        probability=probability,
        success=success,
        objects=np.array(table["object"].to_list()),
        scenes=np.array(table["scene"].to_list()),
    )
    draws = ResampledScores(forecasts, scenes, draw_scenes(scenes, DRAWS, 0)).success_in_bins()
    empty = np.isnan(draws).all(axis=0)
    draws[:, empty] = 0.0
    ends = np.nanquantile(draws, [0.025, 0.975], axis=0)
    ends[:, empty] = np.nan
    return ends[0], ends[1]


def _scores(looks: Sequence[tuple[int, pl.DataFrame]], of: int) -> Table:
    rows = []
    for look, table in looks:
        found = score(
            table["probability"].to_numpy(),
            table["success"].to_numpy() == 1,
            np.array(table["object"].to_list()),
        )
        numbers = (
            *(found.auroc, found.brier, found.ece, found.aurc, found.success_at_50),
            *(found.success_at_70, found.success_at_90, found.success),
        )
        rows.append((Cell.of(after(look, of)), Cell.of(found.n), *map(Cell.of, numbers)))
    return Table(
        key="scores",
        caption="Scores of the probabilities, where there is one: AUROC (higher is better); Brier "
        f"score, calibration error ({BINS} bins) and area under the risk-coverage curve (lower is "
        "better); success rate of the half, 70 % and 90 % with the highest probabilities, and of "
        "all.",
        columns=(
            *("verdicts", "grasps", "AUROC", "Brier", "calibration error", "AURC"),
            *("best 50 %", "best 70 %", "best 90 %", "all"),
        ),
        rows=tuple(rows),
        numeric=(False, *(True for _ in range(9))),
    )
