"""Options of what failures, skipped grasps and looks cost, and the table of thresholds at them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from graspcast.cli.console import print_table, print_text
from graspcast.cli.numbers import number_type
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from graspcast.evaluation.net_benefit import Costs
    from graspcast.evaluation.threshold_table import ThresholdRow, ThresholdTable

__all__ = ["add_costs", "costs_of", "print_thresholds"]

_MOST = 1_000_000.0
_cost = number_type(lambda value: 0 <= value <= _MOST, "a number from 0 to 1,000,000 is")
_DEFAULTS = {"cost_fail": 2.0, "cost_skip": 0.2, "cost_look": 0.05}


def add_costs(verb: argparse.ArgumentParser) -> None:
    """``--cost-fail``, ``--cost-skip``, ``--cost-look``."""
    for name, what in (
        ("fail", "a failed attempt"),
        ("skip", "not attempting"),
        ("look", "each look after the first"),
    ):
        verb.add_argument(
            f"--cost-{name}",
            metavar="X",
            type=_cost,
            help=f"what {what} costs, in units of what a success gains "
            f"(assumed: {_DEFAULTS[f'cost_{name}']:g})",
        )


def costs_of(options: argparse.Namespace) -> Costs:
    """Return the costs that the options state; those that they do not are assumed."""
    from graspcast.evaluation.net_benefit import Costs

    stated = (getattr(options, name) for name in _DEFAULTS)
    given = (
        assumed if value is None else value
        for value, assumed in zip(stated, _DEFAULTS.values(), strict=True)
    )
    return Costs(*given)


def print_thresholds(
    table: ThresholdTable,
    options: argparse.Namespace,
    what: str,
    *,
    measured: ThresholdTable | None = None,
) -> None:
    """Print what thresholds are worth, and the best one if costs were stated.

    Parameters
    ----------
    table
        To print.
    options
        With those of :func:`add_costs`.
    what
        On which data.
    measured
        At the same thresholds on other data, with outcomes; its success rates are shown beside
        those that are expected.
    """
    stated = [name for name in _DEFAULTS if getattr(options, name) is not None]
    assumed = [f"--{name.replace('_', '-')}" for name in _DEFAULTS if name not in stated]
    title = (
        f"Thresholds: {counted(table.n, 'grasp')} in {counted(table.scenes, 'scene')}, {what}.\n"
    )
    title += f"Net benefit per grasp at costs: {table.costs}"
    if assumed:
        title += f"; {', '.join(assumed)} assumed"
    succeed = "succeed" if table.measured else "expected to succeed"
    header = ["threshold", "attempted", succeed, "looks", "net benefit", ""]
    if measured is not None:
        header.insert(3, "succeeded in training scenes, held out")
    rows = []
    for i, row in enumerate(table.rows):
        if row.best and not (stated or row.asked or row.break_even):
            continue
        cells = [_threshold(row.threshold), f"{row.attempted:.3f}"]
        cells += ["-" if row.success is None else str(row.success)]
        if measured is not None:
            beside = measured.rows[i].success
            cells.append("-" if beside is None else str(beside))
        rows.append([*cells, f"{row.looks:.2f}", f"{row.net_benefit:+.3f}", _marks(row, stated)])
    print_table(title, header, rows)
    if table.most is not None and table.most < 1:
        print_text(
            f"Looking ended at {table.most:g}, so what the policy would do at higher thresholds "
            "was not recorded."
        )
    from graspcast.evaluation.threshold_table import advice

    print_text(advice(table) if stated else "State your costs for the best threshold at them.")


def _threshold(value: float) -> str:
    return f"{value:.3f}" if round(value, 3) == value else f"{value:.6g}"


def _marks(row: ThresholdRow, stated: list[str]) -> str:
    marks = {
        "in use": row.asked,
        "break-even": row.break_even,
        "best of these": row.best and bool(stated),
    }
    return ", ".join(mark for mark, holds in marks.items() if holds)
