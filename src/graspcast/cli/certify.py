"""The verb ``certify``: a threshold with a certified success rate."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table, print_text
from graspcast.cli.options import (
    Verbs,
    add_inputs,
    add_json,
    add_ood_alpha,
    add_out,
    add_outcomes,
    count,
    inputs_of,
    new_verb,
    share,
    write_json,
)
from graspcast.errors import MismatchError

if TYPE_CHECKING:
    from graspcast.forecasting.model_card import ModelCard
    from graspcast.guarantees.certificate import Certificate, Guarantee

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``certify``."""
    verb = new_verb(
        verbs,
        "certify",
        _certify,
        "a threshold with a promised success rate",
        "Find the threshold at which attempted grasps succeed at a wanted rate, with a stated\n"
        "confidence, from outcomes that took no part in training; or say that none can be\n"
        "certified, and how much data would be needed. Scenes (or images) are what is taken to\n"
        "be independent: the trials within one bear evidence together.",
    )
    add_inputs(verb)
    verb.add_argument("--model", metavar="PATH", type=Path, required=True, help="from train")
    add_outcomes(verb, required=True)
    verb.add_argument("--rate", metavar="P", type=share, default=0.9, help="default: 0.9")
    verb.add_argument("--confidence", metavar="P", type=share, default=0.9, help="default: 0.9")
    verb.add_argument(
        "--unit",
        choices=("scene", "image"),
        default="scene",
        help="what is drawn anew, independently (default: scene; images of a video are not)",
    )
    verb.add_argument(
        "--weight",
        choices=("attempt", "unit"),
        default="attempt",
        help="whether every attempt counts (default), or every unit with attempts, which needs "
        "fewer units and promises less",
    )
    add_ood_alpha(
        verb, "as for predict: so unusual a disagreement is not attempted (default: 0.01)"
    )
    verb.add_argument("--per-object", action="store_true", help="a promise for each object too")
    verb.add_argument(
        "--simultaneous",
        action="store_true",
        help="all promises hold together with this confidence, not each alone",
    )
    verb.add_argument(
        "--others",
        metavar="N",
        type=count,
        default=0,
        help="with --simultaneous: so many promises of other runs (other grippers) belong to them",
    )
    verb.add_argument(
        "--explore",
        metavar="SHARE",
        type=share,
        default=0.0,
        help="spend this share of the units on where testing should start (default: 0; it starts "
        "where the model's forecasts of training scenes kept apart say, or around the target rate)",
    )
    verb.add_argument("--seed", metavar="N", type=int, default=0, help="of the draws")
    verb.add_argument(
        "--allow-training-scenes",
        action="store_true",
        help="go on though the model has seen some of the scenes; the promise then means nothing",
    )
    add_out(verb, "the promise's file (JSON)")
    add_json(verb)


def _certify(options: argparse.Namespace) -> None:
    import platform

    import numpy as np

    from graspcast._version import __version__
    from graspcast.estimates.instances import unit_names
    from graspcast.estimates.loading import load_outcomes
    from graspcast.forecasting.forecaster import Forecaster
    from graspcast.forecasting.training_data import TrainingData
    from graspcast.guarantees.certify import certify
    from graspcast.guarantees.threshold_sequence import explore, learn_sequence

    forecaster = Forecaster.load(options.model)
    card = forecaster.card
    inputs = inputs_of(options)
    estimates = inputs.estimates(card.principal)
    outcomes = load_outcomes(options.outcomes, estimates.estimators)
    samples = TrainingData.join(estimates, outcomes, card.principal, card.gripper).tried()
    note(*inputs.notes)
    if untried := len(estimates) - len(samples):
        note(f"left out {untried} instances without an outcome")
    success = samples.own_success == 1
    scenes = unit_names(samples.estimates.instances, "scene")
    _check_unseen(card, set(scenes.tolist()), options.allow_training_scenes)
    probability = forecaster.probability(samples.estimates, inputs.models)
    # What a verdict would abstain from is no attempt here either.
    probability[forecaster.p_value(samples.estimates) <= options.ood_alpha] = 0.0
    units = unit_names(samples.estimates.instances, options.unit)
    objects = samples.objects if options.per_object else None
    settings = {"rate": options.rate, "confidence": options.confidence, "weight": options.weight}
    out_of_fold = getattr(forecaster.predictor, "out_of_fold", None)
    if options.explore or out_of_fold is None:
        sequence, kept = explore(
            probability,
            success,
            units,
            spend=options.explore,
            seed=options.seed,
            **settings,
        )
    else:
        kept = np.ones(len(units), dtype=bool)
        sequence = learn_sequence(
            out_of_fold.probability,
            out_of_fold.success,
            out_of_fold.units(options.unit),
            calibration_units=len(np.unique(units)),
            **settings,
        )
    certificate = certify(
        probability[kept],
        success[kept],
        units[kept],
        objects=None if objects is None else objects[kept],
        sequence=sequence,
        simultaneous=options.simultaneous,
        others=options.others,
        seed=options.seed,
        provenance={
            "model": card.digest,
            "ood_alpha": options.ood_alpha,
            "principal": card.principal,
            "gripper": card.gripper,
            "unit": options.unit,
            "versions": {
                "graspcast": __version__,
                "python": platform.python_version(),
                "numpy": np.__version__,
            },
        },
        **settings,
    )
    certificate.save(options.out)
    write_json(options.json, certificate.as_dict())
    _print_promises(certificate, options.unit)
    print_text(f"{options.out}: {certificate.overall}")


def _check_unseen(card: ModelCard, scenes: set[str], allowed: bool) -> None:
    trained = getattr(card, "scenes", ())
    if not trained:
        note(
            "the model does not say which scenes it was trained on: that these are others is yours"
        )
        return
    seen = sorted(scenes & set(trained))
    if not seen:
        return
    some = ", ".join(seen[:5]) + (", ..." if len(seen) > 5 else "")
    if not allowed:
        raise MismatchError(
            f"the model was trained on {len(seen)} of the {len(scenes)} calibration scenes "
            f"({some}); give outcomes of others (or --allow-training-scenes, and promise nothing)"
        )
    note(f"{len(seen)} calibration scenes were trained on ({some}): the promise means nothing")


def _print_promises(certificate: Certificate, unit: str) -> None:
    together = (
        f"all {certificate.family} together"
        if certificate.family > 1
        else "each promise for itself"
    )
    title = (
        f"success rate >= {certificate.rate:g}, confidence {certificate.confidence:g} ({together})"
    )
    header = ["attempts", "threshold", "shown at", f"{unit}s", "with one drawn", "succeeded"]
    header += ["lower bound", "attempted", "interval", "of these held", f"{unit}s needed"]
    print_table(title, header, [_row(p) for p in certificate.guarantees])


def _row(guarantee: Guarantee) -> list[str]:
    low, high = guarantee.attempt_interval
    held = f"{guarantee.attempts_held / guarantee.attempts:.3f}" if guarantee.attempts else "-"
    needed = "-"
    if guarantee.threshold is None:
        needed = "never" if guarantee.needed_units is None else str(guarantee.needed_units)
    return [
        guarantee.scope,
        "none" if guarantee.threshold is None else f"{guarantee.threshold:.3f}",
        f"{guarantee.shown_at:.3f}",
        str(guarantee.units),
        str(guarantee.attempted_units),
        str(guarantee.successes),
        f"{guarantee.lower:.3f}",
        f"{guarantee.attempt_rate:.3f}",
        f"{low:.3f}-{high:.3f}",
        held,
        needed,
    ]
