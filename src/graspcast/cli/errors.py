"""The verb ``errors``: pose errors of each estimator and object."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspcast.cli.console import note, print_table
from graspcast.cli.options import (
    Verbs,
    add_inputs,
    add_json,
    inputs_of,
    new_verb,
    write_json,
)
from graspcast.cli.progress import progress_bar
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from polars import DataFrame

__all__ = ["add"]

_SHORT = {"translation_mm": "transl._mm", "add_s_mm": "ADD-S_mm", "add_mm": "ADD_mm"}
_SHORT |= {"mssd_mm": "MSSD_mm", "mspd_px": "MSPD_px"}
_HEADS = {"obj_id": "object", "ray_share_50": "ray share\n50 %"}
_HEADS |= {f"rotation_deg_{q}": f"rot._deg\n{q} %" for q in (50, 75, 95)}
_HEADS |= {f"translation_mm_{q}": f"transl._mm\n{q} %" for q in (50, 75, 95)}
_HEADS |= {
    "over_30_deg": "share\n> 30°",
    "over_90_deg": "share\n> 90°",
    "over_50_mm": "share\n> 50 mm",
}


def add(verbs: Verbs) -> None:
    """Add the verb ``errors``."""
    verb = new_verb(
        verbs,
        "errors",
        _errors,
        "pose errors of each estimator and object",
        "Print the pose errors of each estimator and object against ground truth: rotation,\n"
        "translation and its share along the viewing ray, ADD, ADD-S, MSSD and MSPD.",
    )
    add_inputs(verb, bop_required=True)
    verb.add_argument(
        "--statistic", choices=("mean", "median"), default="median", help="default: median"
    )
    verb.add_argument(
        "--out",
        metavar="PATH",
        type=Path,
        help="write the errors of every estimate (CSV or Parquet)",
    )
    verb.add_argument(
        "--shape",
        action="store_true",
        help="print the tails of the errors instead, and their correlation between estimators",
    )
    add_json(verb)


def _errors(options: argparse.Namespace) -> None:
    import polars as pl

    from graspcast.estimates.error_statistics import MEASURED
    from graspcast.estimates.error_tables import MEASURES, measure, summarise
    from graspcast.io.tables import write_table

    inputs = inputs_of(options)
    shape_alone = options.shape and not (options.out or options.json)
    only = MEASURED if shape_alone else tuple(MEASURES)
    # A file without estimates has no errors; the notes say so.
    jobs = [(d, e, t) for d, tables in inputs.results.items() for e, t in tables.items() if len(t)]
    parts, figures = [], {}
    with progress_bar("measuring") as move:
        for i, (dataset, estimator, results) in enumerate(jobs):
            message = f"measuring {estimator} on {dataset}"

            def step(share: float, _: str = "", *, i: int = i, message: str = message) -> None:
                move((i + share) / len(jobs), message)

            errors = measure(results, inputs.datasets[dataset], only=only, progress=step)
            if without := len(results) - len(errors):
                lacking = counted(without, "estimate", "has", "have")
                inputs.notes.append(f"{results.source}: {lacking} no ground truth")
            figures[dataset, estimator] = summarise(errors)
            names = (pl.lit(estimator).alias("estimator"), pl.lit(dataset).alias("dataset"))
            parts.append(errors.select(*names, pl.all()))
    note(*inputs.notes, *inputs.lengths)
    if options.shape:
        shape = _shape(parts)
    else:
        _print_errors(figures, options.statistic)
    if options.out:
        write_table(options.out, pl.concat(parts))
    write_json(
        options.json,
        {
            "errors": {
                dataset: {e: t.to_dicts() for (d, e), t in figures.items() if d == dataset}
                for dataset in inputs.results
            },
            **({"shape": shape} if options.shape else {}),
        },
    )


def _print_errors(figures: Mapping[tuple[str, str], DataFrame], statistic: str) -> None:
    from graspcast.estimates.error_tables import MEASURES

    header = ["object", "n", *(_SHORT.get(m, m).replace("_", "\n") for m in MEASURES)]
    for (dataset, estimator), table in figures.items():
        rows = []
        for row in table.iter_rows(named=True):
            cells = (row[f"{m}_{statistic}"] for m in MEASURES)
            name = "mean" if row["obj_id"] is None else str(row["obj_id"])
            rows.append([name, str(row["n"]), *("-" if c is None else f"{c:.2f}" for c in cells)])
        print_table(f"{estimator} on {dataset}, {statistic}", header, rows)


def _shape(parts: Sequence[DataFrame]) -> dict[str, Any]:
    """Print tails and correlations of each dataset, and return them for JSON."""
    from graspcast.estimates.error_statistics import correlations, tails

    by_dataset: dict[str, dict[str, DataFrame]] = {}
    for part in parts:
        dataset, estimator = part["dataset"][0], part["estimator"][0]
        by_dataset.setdefault(dataset, {})[estimator] = part
    out: dict[str, Any] = {}
    for dataset, tables in by_dataset.items():
        found = {name: tails(table) for name, table in tables.items()}
        for name, table in found.items():
            header = [_HEADS.get(column, column) for column in table.columns]
            print_table(f"{name} on {dataset}", header, [_cells(row) for row in table.rows()])
        pairs = correlations(tables)
        if len(pairs):
            header = ["", "", "n", "rotation", "translation", "both_large"]
            title = f"rank correlation of errors on {dataset}"
            print_table(title, header, [_cells(row) for row in pairs.rows()])
        out[dataset] = {
            "tails": {name: table.to_dicts() for name, table in found.items()},
            "correlations": pairs.to_dicts(),
        }
    return out


def _cells(row: Sequence[Any]) -> list[str]:
    """Format a row's cells: the first is a name, floats get two decimals."""
    first = "all" if row[0] is None else str(row[0])
    rest = ["-" if x is None else f"{x:.2f}" if isinstance(x, float) else str(x) for x in row[1:]]
    return [first, *rest]
