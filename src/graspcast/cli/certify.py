"""The verb ``certify``: a threshold with a guaranteed success rate."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table, print_text
from graspcast.cli.log_options import add_from_log, check_sources, logs_of
from graspcast.cli.options import (
    Verbs,
    add_images,
    add_inputs,
    add_json,
    add_ood_alpha,
    add_out,
    add_outcomes,
    count,
    inputs_with_images,
    new_verb,
    share,
    write_json,
)
from graspcast.cli.progress import progress_bar
from graspcast.cli.promises import confidence_of, print_alternatives, promised, rate_of
from graspcast.cli.view_options import add_policy, motions_of, policy_options
from graspcast.demo_data import model_path
from graspcast.errors import InputError
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from graspcast.estimates.loading import Inputs
    from graspcast.evaluation.certification import GuaranteeOptions
    from graspcast.forecasting.forecaster import Forecaster
    from graspcast.guarantees.certificate import Certificate, Guarantee

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``certify``."""
    verb = new_verb(
        verbs,
        "certify",
        _certify,
        "a threshold with a guaranteed success rate",
        "Find the threshold at which attempted grasps succeed at a given rate, with a given\n"
        "confidence, from outcomes that were not used in training. If there is none, say what can\n"
        "be promised instead, and how much data would be needed. Scenes (or images) are assumed\n"
        "to be independent; the trials within one need not be.",
    )
    add_inputs(verb, required=False)
    add_from_log(verb, "whose decisions by this model are certified")
    add_images(verb)
    verb.add_argument("--model", metavar="PATH", type=model_path, required=True, help="from train")
    add_outcomes(verb, required=False)
    add_policy(
        verb,
        max_looks="certify looking until the probability reaches the threshold, a further look "
        "does not pay, or this many looks were taken (default: 1, one verdict with the views there "
        "are)",
    )
    _add_guarantee_options(verb)
    verb.add_argument("--seed", metavar="N", type=int, default=0, help="of the draws")
    verb.add_argument(
        "--allow-training-scenes",
        action="store_true",
        help="certify though the model was trained on some of the scenes; the guarantee is then "
        "invalid",
    )
    add_out(verb, "the certificate (JSON)")
    add_json(verb)


def _add_guarantee_options(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--rate", metavar="P", type=share, default=0.9, help="default: 0.9")
    verb.add_argument(
        "--accept-lower",
        action="store_true",
        help="where this rate cannot be promised, certify the highest lower one that can; without "
        "this nothing would be attempted",
    )
    verb.add_argument("--confidence", metavar="P", type=share, default=0.9, help="default: 0.9")
    verb.add_argument(
        "--unit",
        choices=("scene", "image"),
        default="scene",
        help="the independent unit (default: scene; images of a video are not independent)",
    )
    verb.add_argument(
        "--weight",
        choices=("attempt", "unit"),
        default="attempt",
        help="weight all attempts equally (default), or all units that have any, which needs "
        "fewer units and guarantees less",
    )
    add_ood_alpha(
        verb,
        "as for predict: what is out of distribution is not attempted (default: 0.01)",
    )
    verb.add_argument("--per-object", action="store_true", help="certify each object too")
    verb.add_argument(
        "--simultaneous",
        action="store_true",
        help="all guarantees hold together with this confidence, not each individually",
    )
    verb.add_argument(
        "--other-guarantees",
        metavar="N",
        type=count,
        default=0,
        help="with --simultaneous: number of guarantees of other runs (other grippers) that are "
        "to hold together with these (default: 0)",
    )
    verb.add_argument(
        "--sequence-share",
        metavar="SHARE",
        type=share,
        default=0.0,
        help="use this share of the units only to learn at which threshold testing starts "
        "(default: 0: learn it from the model's out-of-fold predictions, or start around the "
        "target rate)",
    )


def _certify(options: argparse.Namespace) -> None:
    from graspcast.evaluation.certification import GuaranteeOptions
    from graspcast.forecasting.forecaster import Forecaster
    from graspcast.forecasting.recorded_verdicts import one_view_notes

    check_sources(options, outcomes=True)
    asked = GuaranteeOptions(
        rate=options.rate,
        confidence=options.confidence,
        unit=options.unit,
        weight=options.weight,
        ood_alpha=options.ood_alpha,
        per_object=options.per_object,
        simultaneous=options.simultaneous,
        other_guarantees=options.other_guarantees,
        sequence_share=options.sequence_share,
        accept_lower=options.accept_lower,
        seed=options.seed,
        allow_training_scenes=options.allow_training_scenes,
    )
    forecaster = Forecaster.load(options.model)
    if options.from_log:
        certificate = _of_log(options, forecaster, asked)
        _finish(options, certificate)
        return
    alone = forecaster.visibility
    inputs = inputs_with_images(options, used=alone is not None and alone.uses_image)
    forecaster.card.check_estimators(inputs.estimators)
    several = options.camera_poses or options.guide is not None or options.max_looks > 1
    certified = _with_views if several else _of_one_view
    with progress_bar("certifying"):
        certificate = certified(options, forecaster, inputs, asked)
    # Where camera poses are given, the forecaster was trained with them, or they were refused.
    views = bool(options.camera_poses)
    inputs.add_notes(one_view_notes([forecaster], options.guide, views=views))
    note(*inputs.notes, *inputs.lengths)
    _finish(options, certificate)


def _of_log(
    options: argparse.Namespace, forecaster: Forecaster, asked: GuaranteeOptions
) -> Certificate:
    """Certify what the decisions in attempt logs show."""
    from graspcast.evaluation.logged_certification import certify_log

    unused = ("camera_poses", "images", "bop", "ground_truth", "objects", "scenes")
    if given := [name for name in unused if getattr(options, name)]:
        raise InputError(
            "from a log, its decisions are certified as they were made, without further data",
            parameters=("from_log", *given),
        )
    settings, views = policy_options(options), options.max_looks > 1
    found = certify_log(forecaster, logs_of(options), asked, settings, views=views)
    note(*found.notes)
    return found.certificate


def _finish(options: argparse.Namespace, certificate: Certificate) -> None:
    """Write and print the certificate."""
    seen = certificate.provenance["training_scenes"]
    if seen is None:
        note("the model does not state its training scenes; make sure that these are others")
    elif seen:
        note(f"the model was trained on {seen} calibration scenes: the guarantee is invalid")
    certificate.save(options.out)
    write_json(options.json, certificate.as_dict())
    _print_guarantees(certificate, options.unit)
    print_alternatives(certificate)
    print_text(f"{options.out}: {certificate.overall}")
    print_text(promised(certificate, options.unit))


def _of_one_view(
    options: argparse.Namespace, forecaster: Forecaster, inputs: Inputs, asked: GuaranteeOptions
) -> Certificate:
    """Certify the principal's single views."""
    from dataclasses import asdict

    from graspcast.estimates.loading import load_outcomes
    from graspcast.evaluation.certification import certify_forecaster
    from graspcast.forecasting.training_data import TrainingData

    card = forecaster.card
    estimates = inputs.estimates(card.principal, only=card.estimators)
    outcomes = load_outcomes(options.outcomes, estimates.estimators)
    data = TrainingData.join(estimates, outcomes, card.principal, card.gripper)
    if untried := int((~data.is_tried).sum()):
        inputs.notes.append(f"left out {counted(untried, 'instance')} without an outcome")
    return certify_forecaster(forecaster, data, models=inputs.models, **asdict(asked))


def _with_views(
    options: argparse.Namespace, forecaster: Forecaster, inputs: Inputs, asked: GuaranteeOptions
) -> Certificate:
    """Certify a policy with several views, looks or guides."""
    from graspcast.estimates.outcomes import read_all_outcomes
    from graspcast.evaluation.policy_certification import certify_policy

    outcomes = read_all_outcomes(options.outcomes)
    motions = motions_of(options, inputs)
    settings = policy_options(options)
    certificate = certify_policy(forecaster, inputs, motions, settings, outcomes, asked)
    if not asked.sequence_share:
        inputs.notes.append(
            "testing starts around the target rate, as the model's out-of-fold predictions are of "
            "single views; --sequence-share learns from some of the units where to start"
        )
    return certificate


def _print_guarantees(certificate: Certificate, unit: str) -> None:
    together = (
        f"all {certificate.family_size} together"
        if certificate.family_size > 1
        else "each individually"
    )
    title = (
        f"success rate >= {certificate.rate:g}, confidence {certificate.confidence:g} ({together})"
    )
    if certificate.policy is not None:
        title += f"; {certificate.policy}"
    header = ["scope", "threshold", "reported at", f"{unit}s", "drawn attempts", "succeeded"]
    header += ["lower bound", "attempt rate", "interval", "success rate", f"{unit}s needed"]
    header += ["highest rate", "highest confidence"]
    print_table(title, header, [_row(g) for g in certificate.guarantees])


def _row(guarantee: Guarantee) -> list[str]:
    low, high = guarantee.attempt_rate_interval
    success_rate = "-"
    if guarantee.attempts:
        success_rate = f"{guarantee.successful_attempts / guarantee.attempts:.3f}"
    needed = "-"
    if guarantee.threshold is None or guarantee.is_lower:
        needed = "> 10,000" if guarantee.needed_units is None else str(guarantee.needed_units)
    return [
        guarantee.scope,
        "none" if guarantee.threshold is None else f"{guarantee.threshold:.3f}",
        f"{guarantee.reported_threshold:.3f}",
        str(guarantee.units),
        str(guarantee.drawn_attempts),
        str(guarantee.drawn_successes),
        f"{guarantee.lower_bound:.3f}",
        f"{guarantee.attempt_rate:.3f}",
        f"{low:.3f}-{high:.3f}",
        success_rate,
        needed,
        rate_of(guarantee.best),
        "-" if (most := guarantee.possible_confidence) is None else confidence_of(most),
    ]
