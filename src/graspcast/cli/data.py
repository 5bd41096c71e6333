"""Verbs about data: ``import-release`` and ``errors``."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import note, print_table, print_text, progress_bar
from graspcast.cli.options import (
    Verbs,
    add_inputs,
    add_json,
    add_verb,
    inputs_of,
    write_json,
)

__all__ = ["add_verbs"]

_SHORT = {"translation_mm": "transl._mm", "add_s_mm": "ADD-S_mm", "add_mm": "ADD_mm"}
_SHORT |= {"mssd_mm": "MSSD_mm", "mspd_px": "MSPD_px"}


def add_verbs(verbs: Verbs) -> None:
    """Add this module's verbs."""
    verb = add_verb(
        verbs,
        "import-release",
        _import_release,
        "turn the paper authors' release into BOP files",
        "Turn a checkout of the paper authors' repository into BOP results CSVs, ground truth,\n"
        "outcomes and split, one folder a dataset; every pose comes back exactly.",
    )
    verb.add_argument("release", metavar="RELEASE_DIR", type=Path, help="the checkout")
    verb.add_argument("out", metavar="OUT_DIR", type=Path, help="where lmo/ and ycbv/ are made")

    verb = add_verb(
        verbs,
        "errors",
        _errors,
        "pose errors of each estimator and object",
        "Print the pose errors of each estimator and object against ground truth: rotation,\n"
        "translation, the share of it along the viewing ray, ADD, ADD-S, MSSD and MSPD.",
    )
    add_inputs(verb, bop_required=True)
    verb.add_argument(
        "--statistic", choices=("mean", "median"), default="median", help="default: median"
    )
    verb.add_argument(
        "--out", metavar="PATH", type=Path, help="write every estimate's errors (CSV or Parquet)"
    )
    add_json(verb)


def _import_release(options: argparse.Namespace) -> None:
    from graspcast.bop.release import import_release

    for found in import_release(options.release, options.out):
        poses = ", ".join(f"{name} {n}" for name, n in found.estimates.items())
        print_text(
            f"{found.dataset}: poses {poses}; trials {found.trials}; instances {found.instances}, "
            f"of which {found.unseen} without a pose, since no estimator found them"
        )


def _errors(options: argparse.Namespace) -> None:
    import polars as pl

    from graspcast.outcomes import write_table
    from graspcast.truth import MEASURES, measure, summarise

    inputs = inputs_of(options)
    jobs = [(d, e, t) for d, tables in inputs.results.items() for e, t in tables.items()]
    parts, figures = [], {}
    with progress_bar("measuring") as move:
        for i, (dataset, estimator, results) in enumerate(jobs):
            words = f"measuring {estimator} on {dataset}"

            def step(share: float, i: int = i, words: str = words) -> None:
                move((i + share) / len(jobs), words)

            errors = measure(results, inputs.datasets[dataset], progress=step)
            if without := len(results) - len(errors):
                inputs.notes.append(f"{results.source}: {without} estimates have no ground truth")
            figures[dataset, estimator] = summarise(errors)
            names = (pl.lit(estimator).alias("estimator"), pl.lit(dataset).alias("dataset"))
            parts.append(errors.select(*names, pl.all()))
    for text in inputs.notes:
        note(text)
    header = ["object", "n", *(_SHORT.get(m, m).replace("_", "\n") for m in MEASURES)]
    for (dataset, estimator), table in figures.items():
        rows = []
        for row in table.iter_rows(named=True):
            cells = (row[f"{m}_{options.statistic}"] for m in MEASURES)
            name = "mean" if row["obj_id"] is None else str(row["obj_id"])
            rows.append([name, str(row["n"]), *("-" if c is None else f"{c:.2f}" for c in cells)])
        print_table(f"{estimator} on {dataset}, {options.statistic}", header, rows)
    if options.out:
        write_table(options.out, pl.concat(parts))
    write_json(
        options.json,
        {
            "errors": {
                dataset: {e: t.to_dicts() for (d, e), t in figures.items() if d == dataset}
                for dataset in inputs.results
            }
        },
    )
