"""The verb ``train``: a forecaster from estimates and outcomes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table, print_text, progress_bar
from graspcast.cli.options import (
    Verbs,
    add_inputs,
    add_json,
    add_out,
    add_outcomes,
    inputs_of,
    new_verb,
    positive,
    write_json,
)

if TYPE_CHECKING:
    from graspcast.estimates.loading import Inputs
    from graspcast.forecasting.training_data import TrainingData

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``train``."""
    verb = new_verb(
        verbs,
        "train",
        _train,
        "train a forecaster",
        "Train a forecaster of a gripper's success for a principal estimator and its supporters,\n"
        "print its scores on scenes kept apart from training, and write it as one file.",
    )
    add_inputs(verb)
    verb.add_argument("--principal", metavar="NAME", required=True, help="guides the grasp")
    verb.add_argument("--gripper", metavar="NAME", required=True, help="whose outcomes to learn")
    add_outcomes(verb, required=False)
    verb.add_argument(
        "--simulated",
        metavar="DIR",
        type=Path,
        action="append",
        default=[],
        help="a campaign (best: simulate --transferred-errors) from which to learn objects "
        "without outcomes",
    )
    verb.add_argument(
        "--method",
        choices=("blend", "two-stage", "direct", "threshold", "MLP", "MLP-O"),
        default="blend",
        help="two stages and a direct forest blended (default), either alone; threshold on ADD; "
        "the paper's networks for each object, or for all",
    )
    verb.add_argument(
        "--trees", metavar="N", type=positive, default=128, help="of each forest (default: 128)"
    )
    verb.add_argument(
        "--features",
        choices=("paper", "rich"),
        default="rich",
        help="what networks see (default: rich)",
    )
    verb.add_argument(
        "--protocol",
        choices=("validated", "last"),
        default="validated",
        help="which checkpoint of a network to keep (default: validated)",
    )
    verb.add_argument("--members", metavar="N", type=positive, default=5, help="default: 5")
    verb.add_argument("--epochs", metavar="N", type=positive, default=3000, help="default: 3000")
    verb.add_argument("--seed", metavar="N", type=int, default=0, help="of everything random")
    verb.add_argument(
        "--folds",
        metavar="N",
        type=int,
        default=5,
        help="parts of the scenes for cross-validation; 0 for none (default: 5)",
    )
    verb.add_argument(
        "--unseen-objects",
        action="store_true",
        help="also score each object by a forecaster that has not seen it",
    )
    add_out(verb, "the model's file (npz)")
    add_json(verb)


def _train(options: argparse.Namespace) -> None:
    from dataclasses import replace

    from graspcast.evaluation.cross_validation import cross_validate
    from graspcast.forecasting.models.blend import ForestSettings
    from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
    from graspcast.forecasting.models.mlp.types import MlpSettings
    from graspcast.forecasting.train import train_forecaster

    inputs = inputs_of(options)
    learned = _lessons(options, inputs)
    note(*inputs.notes)
    settings = {
        "method": options.method,
        "features": options.features,
        "models": inputs.models,
        "forests": ForestSettings(trees=options.trees, seed=options.seed),
        "settings": NetworkSettings(
            protocol=options.protocol,
            members=options.members,
            seed=options.seed,
            optimiser=MlpSettings(epochs=options.epochs),
        ),
    }
    scores = {}
    scored = bool(options.outcomes)
    if not scored:
        note("no scores: without --outcomes there is nothing to hold a forecast against")
    if scored and options.folds > 1:
        with progress_bar("cross-validating") as move:
            found = cross_validate(
                learned, folds=options.folds, seed=options.seed, progress=move, **settings
            )
        scores["unseen_scenes"] = found.as_dict()
    if scored and options.unseen_objects:
        with progress_bar("leaving out each object") as move:
            found = cross_validate(learned, by="object", progress=move, **settings)
        scores["unseen_objects"] = found.as_dict()
    with progress_bar("training") as move:
        forecaster = train_forecaster(learned, progress=move, **settings)
    card = replace(forecaster.card, scores=scores)
    forecaster = replace(forecaster, card=card)
    if scores:
        rows = [
            [measure.replace("_", " "), *(_figure(s[measure]) for s in scores.values())]
            for measure in next(iter(scores.values()))
        ]
        header = [options.method, *(name.replace("_", " ") for name in scores)]
        print_table(f"{options.method}, scores on what training has not seen", header, rows)
    forecaster.save(options.out)
    write_json(options.json, {"card": card.as_dict()})
    simulated = f" ({len(card.simulated)} by simulation alone)" if card.simulated else ""
    print_text(
        f"{options.out}: {options.principal} with {', '.join(card.supporters)}, "
        f"{options.gripper} gripper, {len(card.objects)} objects{simulated}, "
        f"{card.samples} samples"
    )


def _lessons(options: argparse.Namespace, inputs: Inputs) -> TrainingData:
    """All that the options give to learn from; says what they lack."""
    import numpy as np

    from graspcast.errors import InputError
    from graspcast.estimates.loading import load_outcomes
    from graspcast.estimates.matching import true_poses
    from graspcast.forecasting.samples import join
    from graspcast.forecasting.training_data import SimulatedTrials, training_data

    estimates = inputs.estimates(options.principal)
    outcomes = None
    if options.outcomes:
        outcomes = load_outcomes(options.outcomes, estimates.estimators)
        untried = join(estimates, outcomes, options.principal, options.gripper).untried
        if untried:
            inputs.notes.append(f"{untried} instances have no outcome")
    simulated = None
    if options.simulated:
        simulated = SimulatedTrials.read(options.simulated, options.gripper)
    if outcomes is None and simulated is None:
        raise InputError("there is nothing to learn from: give --outcomes, --simulated, or both")
    truth = None
    if options.method in ("blend", "two-stage"):
        if options.method == "two-stage" or outcomes is None:
            truth = true_poses(estimates, options.principal, inputs.datasets)
        else:
            truth = inputs.truth(estimates, options.principal)
        if truth is not None and (without := int(np.isnan(truth[:, 0, 0]).sum())):
            inputs.notes.append(f"{without} instances have no ground truth")
    return training_data(
        estimates, outcomes, options.principal, options.gripper, truth=truth, simulated=simulated
    )


def _figure(value: float | int | None) -> str:
    return f"{value:.3f}" if isinstance(value, float) else "-" if value is None else str(value)
