"""Verbs about learning: ``train``, ``predict`` and ``reproduce``."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import note, print_table, print_text, progress_bar
from graspcast.cli.options import (
    Verbs,
    add_inputs,
    add_json,
    add_out,
    add_outcomes,
    add_verb,
    inputs_of,
    positive,
    share,
    write_json,
)
from graspcast.errors import MismatchError

__all__ = ["add_verbs"]


def add_verbs(verbs: Verbs) -> None:
    """Add this module's verbs."""
    _add_train(verbs)
    _add_predict(verbs)
    verb = add_verb(
        verbs,
        "reproduce",
        _reproduce,
        "the paper's Tables I to III beside ours",
        "Print the paper's Tables I, II and III as paper | ours | difference, and below Table III\n"
        "the same networks by honest protocols, as Markdown.",
    )
    verb.add_argument(
        "--data",
        metavar="DIR",
        type=Path,
        required=True,
        help="holds published/ (what import-release writes), bop/, and raw/ if there is one",
    )
    verb.add_argument(
        "--seeds", metavar="N", type=positive, default=1, help="train with so many seeds"
    )
    add_outcomes(
        verb,
        required=False,
        what="outcomes of one's own (a campaign's directory) instead of the published ones",
    )
    add_json(verb)


def _add_train(verbs: Verbs) -> None:
    verb = add_verb(
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
    add_outcomes(verb, required=True)
    verb.add_argument(
        "--method",
        choices=("threshold", "MLP", "MLP-O"),
        default="MLP-O",
        help="threshold on ADD, networks for each object, or for all (default)",
    )
    verb.add_argument(
        "--features",
        choices=("paper", "rich"),
        default="rich",
        help="what networks see (default: rich, which needs --bop)",
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


def _add_predict(verbs: Verbs) -> None:
    verb = add_verb(
        verbs,
        "predict",
        _predict,
        "verdicts on estimates",
        "Write a verdict on every instance of the principal's: attempt or abstain. Where a\n"
        "supporter has no estimate there is no forecast, and the verdict is to abstain.",
    )
    add_inputs(verb)
    verb.add_argument("--model", metavar="PATH", type=Path, required=True, help="from train")
    verb.add_argument(
        "--threshold",
        metavar="P",
        type=share,
        default=0.5,
        help="attempt at this probability or above it (default: 0.5)",
    )
    add_out(verb, "the verdicts' CSV")


def _train(options: argparse.Namespace) -> None:
    from dataclasses import replace

    from graspcast.inputs import load_outcomes
    from graspcast.learning.forecaster import cross_validate, train_forecaster
    from graspcast.learning.mlp_training import MlpSettings
    from graspcast.learning.predictors import NetworkSettings
    from graspcast.learning.samples import join

    inputs = inputs_of(options)
    estimates = inputs.estimates(options.principal)
    outcomes = load_outcomes(options.outcomes, estimates.estimators)
    samples = join(estimates, outcomes, options.principal, options.gripper)
    for text in inputs.notes:
        note(text)
    if samples.untried:
        note(f"left out {samples.untried} instances without an outcome")
    settings = {
        "method": options.method,
        "features": options.features,
        "models": inputs.models,
        "settings": NetworkSettings(
            protocol=options.protocol,
            members=options.members,
            seed=options.seed,
            optimiser=MlpSettings(epochs=options.epochs),
        ),
    }
    scores = {}
    if options.folds > 1:
        with progress_bar("cross-validating") as move:
            found = cross_validate(
                samples, folds=options.folds, seed=options.seed, progress=move, **settings
            )
        scores["unseen_scenes"] = found.as_dict()
    if options.unseen_objects:
        with progress_bar("leaving out each object") as move:
            found = cross_validate(samples, by="object", progress=move, **settings)
        scores["unseen_objects"] = found.as_dict()
    with progress_bar("training") as move:
        forecaster = train_forecaster(samples, progress=move, **settings)
    forecaster = replace(forecaster, card=replace(forecaster.card, scores=scores))
    if scores:
        rows = [
            [measure.replace("_", " "), *(_figure(s[measure]) for s in scores.values())]
            for measure in next(iter(scores.values()))
        ]
        header = [options.method, *(name.replace("_", " ") for name in scores)]
        print_table(f"{options.method}, scores on what training has not seen", header, rows)
    forecaster.save(options.out)
    write_json(options.json, {"card": forecaster.card.as_dict()})
    print_text(
        f"{options.out}: {options.principal} with {', '.join(forecaster.card.supporters)}, "
        f"{options.gripper} gripper, {len(forecaster.card.objects)} objects, {len(samples)} samples"
    )


def _figure(value: float | int | None) -> str:
    return f"{value:.3f}" if isinstance(value, float) else "-" if value is None else str(value)


def _predict(options: argparse.Namespace) -> None:
    from graspcast.learning.forecaster import Forecaster
    from graspcast.verdict import verdict_rows, write_verdicts

    forecaster = Forecaster.load(options.model)
    inputs = inputs_of(options)
    if len(inputs.results) > 1:
        raise MismatchError(
            f"verdicts are of one dataset, but there are estimates of {', '.join(inputs.results)}"
        )
    estimates = inputs.estimates(forecaster.card.principal)
    probability = forecaster.probability(estimates, inputs.models)
    rows = verdict_rows(estimates, probability, forecaster.card.gripper, options.threshold)
    write_verdicts(options.out, rows)
    for text in inputs.notes:
        note(text)
    attempts = sum(row.verdict.attempt for row in rows)
    print_text(f"{options.out}: {len(rows)} verdicts, {attempts} to attempt")


def _reproduce(options: argparse.Namespace) -> None:
    from graspcast.published import Published
    from graspcast.report.markdown import render
    from graspcast.report.paper import reproduce

    data = Published(options.data, outcomes=options.outcomes)
    with progress_bar("reading") as move:
        found = reproduce(
            data,
            seeds=options.seeds,
            progress=lambda name, done: move(done, f"training {name}"),
        )
    print_text(render(found))
    write_json(options.json, found)
