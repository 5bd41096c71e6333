"""The verb ``predict``: verdicts on estimates."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_text
from graspcast.cli.options import (
    Verbs,
    add_images,
    add_inputs,
    add_ood_alpha,
    add_out,
    count,
    inputs_of,
    inputs_with_images,
    new_verb,
    positive,
    share,
)
from graspcast.cli.view_options import add_policy, motions_of, policy_options
from graspcast.errors import InputError
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from graspcast.estimates.loading import Inputs
    from graspcast.forecasting.fallbacks import Fallbacks
    from graspcast.forecasting.verdict import VerdictRow

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``predict``."""
    verb = new_verb(
        verbs,
        "predict",
        _predict,
        "verdicts on estimates",
        "Write a verdict on every instance of the principal's: attempt or abstain; with camera\n"
        "poses of several images of a scene, also look again, and from where. Where a supporter\n"
        "has no estimate there is no forecast from one view, and the verdict is to abstain,\n"
        "unless a further model was trained without it.",
    )
    add_inputs(verb)
    add_images(verb)
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
        "--explain", action="store_true", help="say which features moved each probability most"
    )
    add_policy(
        verb,
        max_looks="images that a robot would take: where there were fewer, and a "
        "further one is expected to help, the verdict is to look again, and from where (default: "
        "1, never); with --certificate or --stages, how many of the recorded ones may be used",
    )
    verb.add_argument(
        "--stages",
        metavar="FILE",
        type=Path,
        help="look at the recorded images one after another, up to --max-looks, and write the "
        "verdicts after each look to this CSV, with the columns instance, looks and ended; --out "
        "then holds the verdicts at which looking ended",
    )
    _add_transferred(verb)
    add_out(verb, "the verdicts' CSV", others=("stages",))


def _add_transferred(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--transferred-errors",
        metavar="N",
        type=positive,
        help="instead, verdicts on N instances of each object that --objects names, which may be\n"
        "without images: estimates of other objects, seen from random sides, as if they were of it",
    )
    verb.add_argument(
        "--seed", metavar="N", type=count, default=0, help="random seed of --transferred-errors"
    )
    verb.add_argument(
        "--transferred-to",
        metavar="DIR",
        type=Path,
        help="write these estimates as results files too, with their ground truth",
    )


def _predict(options: argparse.Namespace) -> None:
    from graspcast.forecasting.fallbacks import Fallbacks
    from graspcast.forecasting.forecaster import Forecaster
    from graspcast.forecasting.recorded_looks import looks_with_views, verdicts_with_views
    from graspcast.forecasting.recorded_verdicts import one_view_notes
    from graspcast.forecasting.stage_file import write_stages
    from graspcast.forecasting.verdict_file import write_verdicts
    from graspcast.guarantees.certificate import Certificate

    if options.certificate and options.threshold is not None:
        raise InputError("--certificate has its own threshold: leave out --threshold")
    models = Fallbacks(Forecaster.load(path) for path in options.model)
    certificates = [Certificate.load(path) for path in options.certificate]
    used = any(m.visibility is not None and m.visibility.uses_image for m in models)
    if options.transferred_errors is None:
        inputs = inputs_with_images(options, used=used)
    else:
        inputs = _transferred(options, models)
    how = {
        "threshold": 0.5 if options.threshold is None else options.threshold,
        "certificates": certificates,
        "ood_alpha": options.ood_alpha,
    }
    motions = motions_of(options, inputs)
    inputs.add_notes(one_view_notes(models, options.guide, views=bool(motions)))
    if motions or options.guide is not None or options.max_looks > 1 or options.stages:
        if options.explain:
            raise InputError("--explain is of one view: leave out --camera-poses and --guide")
        given = models, inputs, motions, policy_options(options)
        if options.stages:
            looks = looks_with_views(*given, **how)
            write_stages(options.stages, looks)
            rows = [each.last for each in looks]
        else:
            rows = verdicts_with_views(*given, **how)
    else:
        rows = models.verdict_rows(inputs, explain=options.explain, **how)
    write_verdicts(options.out, rows)
    warnings = (f"Warning: {text}." for model in models for text in model.card.warnings)
    note(*inputs.notes, *inputs.lengths, *warnings)
    _print_counts(options.out, rows)
    for certificate in certificates:
        print_text(str(certificate.overall))


def _transferred(options: argparse.Namespace, models: Fallbacks) -> Inputs:
    """Return the estimates of other objects, transferred to those that the options name."""
    from graspcast.estimates.transferred_estimates import transfer_estimates

    if options.camera_poses or options.images:
        raise InputError(
            "transferred estimates have neither images nor camera poses",
            parameters=("camera_poses", "images"),
        )
    principal = next(iter(models)).card.principal
    found = transfer_estimates(
        inputs_of(options, every_object=True),
        principal,
        options.objects,
        count=options.transferred_errors,
        seed=options.seed,
    )
    if options.transferred_to is not None:
        note(*(f"wrote {path}" for path in found.write(options.transferred_to)))
    return found.inputs


def _print_counts(path: Path, rows: Sequence[VerdictRow]) -> None:
    attempts = sum(row.verdict.attempt for row in rows)
    again = sum(row.verdict.look is not None for row in rows)
    unusual = sum(row.verdict.out_of_distribution is True for row in rows)
    print_text(
        f"{path}: {counted(len(rows), 'verdict')}, {attempts} to attempt"
        + (f", {again} to look again" if again else "")
        + (f", {unusual} out of distribution" if unusual else "")
    )
