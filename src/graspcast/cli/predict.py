"""The verb ``predict``: verdicts on estimates."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_text
from graspcast.cli.cost_options import add_costs, costs_of, print_thresholds
from graspcast.cli.decision_options import add_models, add_threshold
from graspcast.cli.options import (
    Verbs,
    add_images,
    add_inputs,
    add_json,
    add_ood_alpha,
    add_out,
    count,
    inputs_of,
    inputs_with_images,
    new_verb,
    positive,
    write_json,
)
from graspcast.cli.progress import progress_bar
from graspcast.cli.view_options import add_policy, motions_of, policy_options
from graspcast.errors import InputError, MismatchError
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from graspcast.estimates.instances import InstanceKey
    from graspcast.estimates.loading import Inputs
    from graspcast.forecasting.fallbacks import Fallbacks
    from graspcast.forecasting.verdict import InstanceLooks, VerdictRow

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
    add_models(verb)
    add_threshold(verb)
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
    _add_stages(verb)
    _add_grasps(verb)
    _add_transferred(verb)
    add_costs(verb)
    add_json(verb)
    add_out(verb, "the verdicts' CSV", others=("stages", "grasps_out"))


def _add_stages(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--stages",
        metavar="FILE",
        type=Path,
        help="look at the recorded images one after another, up to --max-looks, and write the "
        "verdicts after each look to this CSV, with the columns instance, looks and ended; --out "
        "then holds the verdicts at which looking ended",
    )


def _add_grasps(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--reachable",
        metavar="FILE",
        type=Path,
        help="choose among the grasps that the robot can reach, one a row of this CSV (dataset, "
        "scene_id, im_id, obj_id, est_id, grasp); an instance without a row reaches none",
    )
    verb.add_argument(
        "--grasps-out",
        metavar="FILE",
        type=Path,
        help="also write all grasps of each instance to this CSV, the best first, each with its "
        "probability and the number of outcomes on which that rests",
    )


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
    from graspcast.forecasting.grasp_file import read_reachable, write_grasps_of
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
    reachable = None if options.reachable is None else read_reachable(options.reachable)
    how = {
        "threshold": 0.5 if options.threshold is None else options.threshold,
        "certificates": certificates,
        "ood_alpha": options.ood_alpha,
        "reachable": reachable,
    }
    motions = motions_of(options, inputs)
    inputs.add_notes(one_view_notes(models, options.guide, views=bool(motions)))
    looks: list[InstanceLooks] = []
    if motions or options.guide is not None or options.max_looks > 1 or options.stages:
        if options.explain:
            raise InputError("--explain is of one view: leave out --camera-poses and --guide")
        given = models, inputs, motions, policy_options(options)
        with progress_bar("judging") as move:
            if options.stages:
                looks = looks_with_views(*given, progress=move, **how)
                write_stages(options.stages, looks)
                rows = [each.last for each in looks]
            else:
                rows = verdicts_with_views(*given, progress=move, **how)
    else:
        with progress_bar("judging"):
            rows = models.verdict_rows(inputs, explain=options.explain, **how)
    if reachable is not None:
        _check_reachable(options.reachable, reachable, rows)
    if options.grasps_out is not None:
        write_grasps_of(options.grasps_out, rows)
    write_verdicts(options.out, rows)
    warnings = (f"Warning: {text}." for model in models for text in model.card.warnings)
    note(*inputs.notes, *inputs.lengths, *warnings)
    _print_counts(options.out, rows)
    _print_thresholds(options, models, rows, looks)
    for certificate in certificates:
        print_text(str(certificate.overall))
        if certificate.overall.lower is not None:
            print_text("Nothing is attempted; certify --accept-lower accepts the lower rate.")


def _check_reachable(
    path: Path, reachable: Mapping[InstanceKey, frozenset[str]], rows: Sequence[VerdictRow]
) -> None:
    """Say which instances of the file of reachable grasps have no verdict.

    Raises
    ------
    MismatchError
        If none of them has one.
    """
    if not reachable:
        note(f"{path}: has no rows, so no grasp is reachable and every verdict is to abstain")
        return
    known = {row.key for row in rows}
    strange = [key for key in reachable if key not in known]
    if not strange:
        return
    first = ", ".join(f"{name} {value}" for name, value in strange[0]._asdict().items())
    if len(strange) == len(reachable):
        raise MismatchError(
            f"{path}: no row is of an instance with a verdict; the first is of {first}",
            parameters=("reachable",),
        )
    note(
        f"{path}: {len(strange)} of {counted(len(reachable), 'instance')} without a verdict; "
        f"the first is {first}"
    )


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


def _print_thresholds(
    options: argparse.Namespace,
    models: Fallbacks,
    rows: Sequence[VerdictRow],
    looks: Sequence[InstanceLooks],
) -> None:
    """Print what the forecasts expect of thresholds, and what training measured beside it."""
    from graspcast.evaluation.threshold_table import threshold_table
    from graspcast.evaluation.threshold_trials import (
        stored_trials,
        threshold_in_use,
        trials_of_looks,
        trials_of_verdicts,
    )

    if not rows:
        write_json(options.json, {"expected": None, "held_out_in_training": None})
        return
    asked = threshold_in_use(rows)
    trials = trials_of_looks(looks) if looks else trials_of_verdicts(rows)
    table = threshold_table(trials, costs_of(options), asked=asked, most=asked if looks else None)
    measured = None
    # What a model keeps is of single views, guided by its principal.
    if len(models.forecasters) == 1 and all(row.views == 1 for row in rows) and not looks:
        stored = stored_trials(models.forecasters[0])
        if stored is not None:
            measured = threshold_table(
                stored, table.costs, asked=asked, at=[row.threshold for row in table.rows]
            )
    what = "without outcomes: what the forecasts expect"
    print_thresholds(table, options, what, measured=measured)
    held_out = None if measured is None else measured.as_dict()
    write_json(options.json, {"expected": table.as_dict(), "held_out_in_training": held_out})
