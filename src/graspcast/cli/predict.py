"""The verb ``predict``: verdicts on estimates."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import note, print_text
from graspcast.cli.options import (
    Verbs,
    add_inputs,
    add_ood_alpha,
    add_out,
    inputs_of,
    new_verb,
    share,
)
from graspcast.errors import InputError

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``predict``."""
    verb = new_verb(
        verbs,
        "predict",
        _predict,
        "verdicts on estimates",
        "Write a verdict on every instance of the principal's: attempt or abstain. Where a\n"
        "supporter has no estimate there is no forecast, and the verdict is to abstain.",
    )
    add_inputs(verb)
    verb.add_argument(
        "--model",
        metavar="PATH",
        type=Path,
        action="append",
        required=True,
        help="from train; further ones, trained with fewer supporters, serve where a supporter is "
        "missing",
    )
    verb.add_argument(
        "--threshold",
        metavar="P",
        type=share,
        help="attempt at this probability or above it (default: 0.5)",
    )
    verb.add_argument(
        "--certificate",
        metavar="PATH",
        type=Path,
        action="append",
        default=[],
        help="from certify: its threshold instead; one for each model",
    )
    add_ood_alpha(
        verb,
        "abstain where the conformal p-value of a disagreement is this or less, so where it is "
        "out of distribution; 0 accepts every p-value (default: 0.01)",
    )
    verb.add_argument(
        "--explain",
        action="store_true",
        help="say in each reason which features moved the probability most",
    )
    add_out(verb, "the verdicts' CSV")


def _predict(options: argparse.Namespace) -> None:
    from graspcast.forecasting.fallbacks import Fallbacks
    from graspcast.forecasting.forecaster import Forecaster
    from graspcast.forecasting.verdict_file import write_verdicts
    from graspcast.guarantees.certificate import Certificate

    if options.certificate and options.threshold is not None:
        raise InputError("--certificate has its own threshold: leave out --threshold")
    models = Fallbacks(Forecaster.load(path) for path in options.model)
    certificates = [Certificate.load(path) for path in options.certificate]
    inputs = inputs_of(options)
    rows = models.verdict_rows(
        inputs,
        threshold=0.5 if options.threshold is None else options.threshold,
        certificates=certificates,
        ood_alpha=options.ood_alpha,
        explain=options.explain,
    )
    write_verdicts(options.out, rows)
    warnings = (f"Warning: {text}." for model in models for text in model.card.warnings)
    note(*inputs.notes, *inputs.lengths, *warnings)
    attempts = sum(row.verdict.attempt for row in rows)
    unusual = sum(row.verdict.out_of_distribution is True for row in rows)
    print_text(
        f"{options.out}: {len(rows)} verdicts, {attempts} to attempt"
        + (f", {unusual} out of distribution" if unusual else "")
    )
    for certificate in certificates:
        print_text(str(certificate.overall))
