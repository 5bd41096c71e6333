"""The verb that turns estimates into verdicts: ``predict``."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

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
from graspcast.errors import MismatchError

if TYPE_CHECKING:
    from graspcast.bop.models import Models
    from graspcast.estimates.alignment import Estimates
    from graspcast.forecasting.forecaster import Forecaster
    from graspcast.forecasting.verdict import VerdictRow

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
        help="from train; further ones, trained with fewer supporters, stand in where one is "
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
        "abstain where a disagreement is so unusual that training has at most this share of such; "
        "0 trusts every forecast (default: 0.01)",
    )
    verb.add_argument(
        "--explain", action="store_true", help="say in each reason what moved the probability most"
    )
    add_out(verb, "the verdicts' CSV")


def _predict(options: argparse.Namespace) -> None:
    from graspcast.forecasting.fallbacks import Fallbacks
    from graspcast.forecasting.forecaster import Forecaster
    from graspcast.forecasting.verdict import write_verdicts

    models = Fallbacks(Forecaster.load(path) for path in options.model)
    terms = _Terms(options)
    inputs = inputs_of(options)
    if len(inputs.results) > 1:
        raise MismatchError(
            f"verdicts are of one dataset, but there are estimates of {', '.join(inputs.results)}"
        )
    answered: dict[tuple[int, int, int, int], VerdictRow] = {}
    usable = models.usable(inputs.estimators)
    for forecaster in usable:
        card = forecaster.card
        try:
            estimates = inputs.estimates(card.principal, only=card.estimators)
        except MismatchError as error:  # no instance has all of these
            if forecaster is usable[-1] and not answered:
                raise
            inputs.notes.append(str(error))
            continue
        terms_here = terms.of(forecaster)
        told = f"; with {', '.join(card.supporters)}" if len(usable) > 1 else ""
        for key, row in _verdicts(forecaster, estimates, inputs.models, terms_here, options, told):
            if key not in answered or answered[key].verdict.probability is None:
                answered[key] = row
    rows = [answered[key] for key in sorted(answered)]
    write_verdicts(options.out, rows)
    note(*inputs.notes)
    attempts = sum(row.verdict.attempt for row in rows)
    ood_alpha = sum(row.verdict.out_of_distribution for row in rows)
    print_text(
        f"{options.out}: {len(rows)} verdicts, {attempts} to attempt"
        + (f", {ood_alpha} unfamiliar" if ood_alpha else "")
    )
    for text in terms.guaranteed:
        print_text(text)


class _Terms:
    """Which threshold each model's forecasts are held to: a number, or a promise's."""

    def __init__(self, options: argparse.Namespace):
        from graspcast.errors import InputError
        from graspcast.guarantees.certificate import Certificate

        if options.certificate and options.threshold is not None:
            raise InputError("--certificate brings its own threshold: leave out --threshold")
        self.threshold = 0.5 if options.threshold is None else options.threshold
        self.certificate = {
            certificate.provenance.get("model"): certificate
            for certificate in map(Certificate.load, options.certificate)
        }
        self.ood_alpha: float = options.ood_alpha
        self.guaranteed: list[str] = []

    def of(self, forecaster: Forecaster) -> tuple[float | None, str | None]:
        """Threshold and promise for a model's forecasts.

        Raises
        ------
        MismatchError
            If there are promises but none was made for this model.
        """
        if not self.certificate:
            return self.threshold, None
        card = forecaster.card
        if card.digest not in self.certificate:
            raise MismatchError(
                f"no promise was made for the model with {', '.join(card.supporters)}: certify it, "
                "and give its --certificate too"
            )
        certificate = self.certificate[card.digest]
        certified = certificate.provenance.get("ood_alpha", self.ood_alpha)
        if certified != self.ood_alpha:
            raise MismatchError(
                f"the certificate was made with --ood-alpha {certified:g}, not {self.ood_alpha:g}: "
                "what is attempted would not be what was promised"
            )
        guarantee = certificate.overall
        self.guaranteed.append(str(guarantee))
        return guarantee.threshold, str(guarantee)


def _verdicts(
    forecaster: Forecaster,
    estimates: Estimates,
    models: Mapping[str, Models],
    terms: tuple[float | None, str | None],
    options: argparse.Namespace,
    told: str,
) -> Iterator[tuple[tuple[int, int, int, int], VerdictRow]]:
    """The verdict of one model on every instance, by scene, image, object and instance."""
    from dataclasses import replace

    from graspcast.forecasting.verdict import verdict_rows

    threshold, guarantee = terms
    verdicts = forecaster.verdicts(
        estimates,
        models,
        threshold=threshold,
        guarantee=guarantee,
        ood_alpha=options.ood_alpha,
        explain=options.explain,
    )
    verdicts = [replace(verdict, reason=verdict.reason + told) for verdict in verdicts]
    yield from verdict_rows(estimates, verdicts, forecaster.card.gripper)
