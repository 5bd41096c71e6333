"""Reliability diagrams and risk-coverage curves (needs the extra ``plot``).

The risk-coverage curve is that of selective classification (Geifman and El-Yaniv 2017).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.evaluation.bootstrap import Bootstrap, Interval, ResampledScores, draw_scenes
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.scores import BINS, bin_of, calibration_error, risk_coverage
from graspcast.io.extras import require
from graspcast.io.files import atomic_write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_figures", "reliability_diagram", "risk_coverage_plot"]

# Okabe and Ito, Color Universal Design (2008): distinct for colour-blind readers too.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_GREY = "#6b6b6b"
_MIN_INSTANCES = 10  # bins with fewer have no point
_COVERAGES = np.linspace(0.02, 1.0, 491)  # below, the rate of very few instances
_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 11,
    "figure.facecolor": "white",
    "svg.hashsalt": "graspcast",
    "legend.frameon": False,
}

Panel = dict[str, list[Forecasts]]
"""Method's name to its forecasts for each principal, with one gripper."""


@contextmanager
def _figure(columns: int, rows: int, size: tuple[float, float]) -> Iterator[tuple[Figure, ndarray]]:
    """Yield a figure and its grid of axes, without changing pyplot's state."""
    require("plot")
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=size)
        figure.set_layout_engine("constrained", w_pad=0.1)  # ends of neighbouring axes are labelled
        yield figure, figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)


def _panels(
    forecasts: Sequence[Forecasts], protocol: str, methods: Sequence[str]
) -> dict[str, Panel]:
    """Return forecasts by gripper and method."""
    mine = [f for f in forecasts if f.protocol == protocol and f.method in methods]
    out: dict[str, Panel] = {}
    for gripper in dict.fromkeys(f.gripper for f in mine):
        out[gripper] = {
            m: found
            for m in methods
            if (found := [f for f in mine if (f.method, f.gripper) == (m, gripper)])
        }
    if not out:
        raise InputError(f"no forecasts of {', '.join(methods)} in {protocol} to draw")
    return out


def _save(figure: Figure, path: Path) -> None:
    """Write SVG and PNG, atomically and without the time, so that runs can be compared."""
    for kind, metadata in (("svg", {"Date": None}), ("png", {"Software": None})):
        with atomic_write(path.with_suffix(f".{kind}")) as temporary:
            figure.savefig(temporary, format=kind, dpi=150, metadata=metadata)


def _pooled(parts: Sequence[Forecasts]) -> Forecasts:
    """Return the forecasts of all principals, concatenated."""
    one = parts[0]
    columns = [
        np.concatenate([getattr(f, name) for f in parts])
        for name in ("probability", "success", "objects", "scenes")
    ]
    return Forecasts(one.protocol, one.method, "all", one.gripper, *columns)


def _draw_reliability(
    axes: Axes, parts: Sequence[Forecasts], colour: str, bootstrap: Bootstrap
) -> None:
    f = _pooled(parts)
    number = bin_of(f.probability)
    size = np.bincount(number, minlength=BINS)
    scenes = np.unique(f.scenes).tolist()
    counts = draw_scenes(scenes, bootstrap.draws, bootstrap.seed)
    rates = ResampledScores(f, scenes, counts).success_in_bins()
    shown = np.flatnonzero(size >= _MIN_INSTANCES)
    x = np.bincount(number, weights=f.probability, minlength=BINS)[shown] / size[shown]
    y = np.bincount(number, weights=f.success, minlength=BINS)[shown] / size[shown]
    intervals = [
        Interval.of(rate, rates[:, k], (0.0, 1.0), confidence=bootstrap.confidence)
        for k, rate in zip(shown, y, strict=True)
    ]
    # Number of instances in each bin, along the bottom; the largest a quarter of the height.
    edges = np.arange(BINS) / BINS
    axes.bar(edges, 0.25 * size / size.max(), 1 / BINS, align="edge", color=colour, alpha=0.2, lw=0)
    axes.plot([0, 1], [0, 1], color=_GREY, lw=1, ls=(0, (4, 3)))
    low, high = [i.low for i in intervals], [i.high for i in intervals]
    axes.vlines(x, low, high, color=colour, lw=1.5, alpha=0.7)
    axes.plot(x, y, "o-", color=colour, lw=1.5, ms=4.5)
    ece = np.mean([calibration_error(p.probability, p.success) for p in parts])
    axes.text(0.04, 0.95, f"ECE {ece:.3f}", va="top", transform=axes.transAxes)
    axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal")


def reliability_diagram(
    forecasts: Sequence[Forecasts],
    path: Path,
    *,
    methods: Sequence[str],
    protocol: str = "unseen_scenes",
    bootstrap: Bootstrap | None = None,
) -> None:
    """Draw reliability diagrams, one panel for each method and gripper, as SVG and PNG.

    Bins are those of the calibration error, principals pooled. A point is a bin's mean probability
    and success rate; its bar is the interval of a bootstrap over scenes, and shading shows the
    number of instances. Bins of fewer than ten instances have no point. ECE is the mean over
    principals, as in tables.

    Raises
    ------
    InputError
        If there is nothing to draw.
    ExtraMissingError
        Without matplotlib.
    """
    bootstrap = bootstrap or Bootstrap()
    panels = _panels(forecasts, protocol, methods)
    columns, rows = len(methods), len(panels)
    with _figure(columns, rows, (0.7 + 2.5 * columns, 0.5 + 2.4 * rows)) as (figure, grid):
        for i, (gripper, panel) in enumerate(panels.items()):
            grid[i, 0].set_ylabel(f"{gripper} gripper\nsuccess rate")
            for column, method in enumerate(methods):
                axes = grid[i, column]
                if method not in panel:
                    axes.set_visible(False)
                    continue
                colour = _COLOURS[column % len(_COLOURS)]
                _draw_reliability(axes, panel[method], colour, bootstrap)
                if i == 0:
                    axes.set_title(method)
                if i == rows - 1:
                    axes.set_xlabel("forecast probability")
        _save(figure, path)


def _risk(parts: Sequence[Forecasts]) -> tuple[Float[ndarray, " c"], float]:
    """Return the risk at each coverage and the area, averaged over principals."""
    curves = [risk_coverage(f.probability, f.success) for f in parts]
    risk = np.mean([np.interp(_COVERAGES, c.coverage, c.risk) for c in curves], axis=0)
    return risk, float(np.mean([c.area for c in curves]))


def risk_coverage_plot(
    forecasts: Sequence[Forecasts],
    path: Path,
    *,
    methods: Sequence[str],
    protocol: str = "unseen_scenes",
) -> None:
    """Draw risk-coverage curves, one panel for each gripper, as SVG and PNG.

    Raises
    ------
    InputError
        If there is nothing to draw.
    ExtraMissingError
        Without matplotlib.
    """
    panels = _panels(forecasts, protocol, methods)
    with _figure(len(panels), 1, (4.6 * len(panels), 4.0)) as (figure, grid):
        for axes, (gripper, panel) in zip(grid[0], panels.items(), strict=True):
            for i, method in enumerate(m for m in methods if m in panel):
                risk, area = _risk(panel[method])
                colour = _COLOURS[i % len(_COLOURS)]
                axes.plot(_COVERAGES, risk, color=colour, lw=1.8, label=f"{method}  {area:.3f}")
            ideal = [_perfect(f) for f in next(iter(panel.values()))]
            risk, area = _risk(ideal)
            axes.plot(
                _COVERAGES, risk, color=_GREY, lw=1.2, ls=":", label=f"perfect ranking  {area:.3f}"
            )
            axes.set_title(f"{gripper} gripper")
            axes.set_xlabel("share of grasps attempted")
            axes.legend(title="AURC", loc="upper left", alignment="left", fontsize=9)
            axes.set(xlim=(0, 1))
        grid[0][0].set_ylabel("failure rate of attempts")
        top = max(float(axes.get_ylim()[1]) for axes in grid[0])
        grid[0][0].set_ylim(0, 1.25 * top)  # room for the legend
        _save(figure, path)


def _perfect(f: Forecasts) -> Forecasts:
    """Return perfect forecasts."""
    columns: tuple[Any, ...] = (f.success.astype(np.float64), f.success, f.objects, f.scenes)
    return Forecasts(f.protocol, "perfect", f.principal, f.gripper, *columns)


def draw_figures(
    forecasts: Sequence[Forecasts],
    directory: Path,
    *,
    methods: Sequence[str],
    bootstrap: Bootstrap | None = None,
) -> list[Path]:
    """Draw both figures of the protocol ``unseen_scenes``; return the paths of the SVG files."""
    reliability, risk = directory / "reliability.svg", directory / "risk_coverage.svg"
    reliability_diagram(forecasts, reliability, methods=methods, bootstrap=bootstrap)
    risk_coverage_plot(forecasts, risk, methods=methods)
    return [reliability, risk]
