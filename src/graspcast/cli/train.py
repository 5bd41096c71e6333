"""The verb ``train``: train a forecaster on estimates and outcomes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspcast.cli.console import note, print_table, print_text
from graspcast.cli.cost_options import add_costs, costs_of, print_thresholds
from graspcast.cli.log_options import add_from_log, check_sources, recorded_of
from graspcast.cli.options import (
    Verbs,
    add_images,
    add_inputs,
    add_json,
    add_out,
    add_outcomes,
    inputs_with_images,
    new_verb,
    positive,
    write_json,
)
from graspcast.cli.progress import progress_bar
from graspcast.cli.view_options import add_views, fusion_options, motions_of
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from graspcast.attempt_log.recorded import Recorded
    from graspcast.estimates.loading import Inputs
    from graspcast.evaluation.threshold_trials import HeldOut
    from graspcast.forecasting.forecaster import Forecaster
    from graspcast.forecasting.model_card import ModelCard
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
        "print its cross-validated scores on scenes that are not in training, and write it as one\n"
        "file. One estimator alone is forecast by how well the object is seen, which is much\n"
        "weaker; with camera poses, by several views.",
    )
    add_inputs(verb, required=False)
    add_from_log(verb, "whose outcomes are trained on")
    add_images(verb)
    verb.add_argument(
        "--principal", metavar="NAME", required=True, help="estimator that guides the grasp"
    )
    verb.add_argument("--gripper", metavar="NAME", required=True, help="gripper of the outcomes")
    add_outcomes(verb, required=False)
    _add_learned(verb)
    _add_grasps(verb)
    verb.add_argument(
        "--simulated",
        metavar="DIR",
        type=Path,
        action="append",
        default=[],
        help="a campaign (best: simulate --transferred-errors) on which to train for objects "
        "without outcomes; may be repeated",
    )
    verb.add_argument(
        "--method",
        choices=("blend", "two-stage", "direct", "threshold", "MLP", "MLP-O"),
        default="blend",
        help="the two-stage model and the direct forest blended (default), or either alone; a "
        "threshold on ADD; the paper's networks for each object, or for all; blend and two-stage "
        "need ground truth",
    )
    add_views(
        verb,
        views_from="all",
        why="; with them, the model also forecasts with several views",
    )
    _add_forest_options(verb)
    _add_network_options(verb)
    verb.add_argument("--seed", metavar="N", type=int, default=0, help="of everything random")
    verb.add_argument(
        "--folds",
        metavar="N",
        type=int,
        default=5,
        help="folds of scenes for cross-validation; 0 for none (default: 5)",
    )
    verb.add_argument(
        "--unseen-objects",
        action="store_true",
        help="also score each object by a forecaster trained without it",
    )
    add_costs(verb)
    add_out(verb, "the model's file (npz)")
    add_json(verb)


def _add_learned(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--learn-from",
        metavar="NAME",
        action="append",
        default=[],
        help="an estimator whose outcomes teach how pose errors make grasps fail (success given "
        "error of blend and two-stage), but that the model does not need afterwards; may be "
        "repeated; one estimator is left with camera poses, or two or more",
    )


def _add_grasps(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--grasps",
        metavar="FILE",
        type=Path,
        help="own grasps (TOML) that the outcomes are of; the model file carries them, and the "
        "built-in ones otherwise, so that verdicts at the robot have gripper poses",
    )


def _add_forest_options(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--trees",
        metavar="N",
        type=positive,
        default=128,
        help="trees of each forest (default: 128)",
    )


def _add_network_options(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--features",
        choices=("paper", "rich"),
        default="rich",
        help="input features of networks (default: rich)",
    )
    verb.add_argument(
        "--protocol",
        choices=("validated", "last"),
        default="validated",
        help="which checkpoint of a network to select (default: validated)",
    )
    verb.add_argument(
        "--members",
        metavar="N",
        type=positive,
        default=5,
        help="networks of an ensemble (default: 5)",
    )
    verb.add_argument(
        "--epochs",
        metavar="N",
        type=positive,
        default=3000,
        help="epochs of networks (default: 3000)",
    )


def _train(options: argparse.Namespace) -> None:
    from dataclasses import replace

    from graspcast.evaluation.cross_validation import cross_validate
    from graspcast.evaluation.threshold_trials import held_out
    from graspcast.forecasting.models.blend import ForestSettings
    from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
    from graspcast.forecasting.models.mlp.types import MlpSettings
    from graspcast.forecasting.train import fit_forecaster
    from graspcast.simulation.grasps.table import read_grasps

    inputs, data = _inputs_and_data(options)
    note(*inputs.notes, *inputs.lengths)
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
    scores: dict[str, dict[str, Any]] = {}
    scored = bool(options.outcomes or options.from_log)
    if not scored:
        note("no scores, since without --outcomes there are no outcomes to compare forecasts with")
    others: dict[str, HeldOut] = {}
    if scored and options.folds > 1:
        folds = {"folds": options.folds, "seed": options.seed}
        with progress_bar("cross-validating") as move:
            others = held_out(data, progress=move, **folds, **settings)
        scores |= {name: found.scores.as_dict() for name, found in others.items()}
    if scored and options.unseen_objects:
        with progress_bar("leaving out each object") as move:
            by_object = cross_validate(data, by="object", progress=move, **settings)
        scores["unseen_objects"] = by_object.as_dict()
    with progress_bar("training") as move:
        forecaster = fit_forecaster(data, progress=move, **settings)
    card = replace(forecaster.card, scores=scores)
    forecaster = replace(forecaster, card=card)
    forecaster = forecaster.with_objects(inputs.models, read_grasps(options.grasps))
    if scores:
        rows = [
            [measure.replace("_", " "), *(_figure(s[measure]) for s in scores.values())]
            for measure in next(iter(scores.values()))
        ]
        header = [card.method, *(name.replace("_", " ") for name in scores)]
        print_table(f"{card.method}, cross-validated scores", header, rows)
    thresholds = _print_thresholds(options, forecaster, others)
    forecaster.save(options.out)
    note(*(f"Warning: {text}." for text in card.warnings), _carried(forecaster, options.grasps))
    write_json(options.json, {"card": card.as_dict(), "thresholds": thresholds})
    print_text(f"{options.out}: {_told(card, views=data.views is not None)}")


def _told(card: ModelCard, *, views: bool) -> str:
    """Say for what a model was trained, and on how much."""
    from graspcast.forecasting.one_estimator import ALONE

    simulated = f" ({len(card.simulated)} by simulation alone)" if card.simulated else ""
    grasps = f" with {counted(len(card.targets), 'grasp')}" if card.grasps else ""
    together = f" with {', '.join(card.supporters)}" if card.supporters else " alone"
    seen = ", one view" if card.method == ALONE else ""
    seen = ", one or more views" if views else seen
    more = "".join(f", {n} of {name}" for name, n in card.learned_from.items())
    learned = f", {counted(card.samples, 'sample')}" if card.samples else ""
    return (
        f"{card.principal}{together}{seen}, {card.gripper} gripper, "
        f"{counted(len(card.objects), 'object')}{simulated}{grasps}{learned}{more}"
    )


def _inputs_and_data(options: argparse.Namespace) -> tuple[Inputs, TrainingData]:
    """Read files, or attempt logs."""
    check_sources(options, outcomes=False)
    logged = recorded_of(options) if options.from_log else None
    inputs = inputs_with_images(options) if logged is None else logged.inputs
    return inputs, _training_data(options, inputs, logged)


_SEEN = {
    "unseen_scenes": "one look, each grasp forecast without its scene",
    "unseen_scenes_views": "two or three looks, each grasp forecast without its scene",
    "stored": "one look, each grasp forecast without its scene, as the model keeps it",
}


def _carried(forecaster: Forecaster, path: Path | None) -> str:
    """Say which grasps the model file carries for the robot."""
    card, known = forecaster.card, forecaster.known
    assert known is not None
    names = [set(card.grasps_of(name)) <= set(known.grasps.get(name, {})) for name in card.objects]
    source = "the built-in ones" if path is None else f"of {path} and the built-in ones"
    hint = "" if all(names) else "; --grasps gives those that the outcomes are of"
    return (
        f"the model file carries the {card.gripper} gripper's grasps of {sum(names)} of "
        f"{counted(len(names), 'object')} ({source}){hint}"
    )


def _print_thresholds(
    options: argparse.Namespace, forecaster: Forecaster, others: dict[str, HeldOut]
) -> dict[str, Any]:
    """Print what thresholds are worth on scenes that are held out; return the tables, for JSON."""
    from graspcast.evaluation.threshold_table import threshold_table
    from graspcast.evaluation.threshold_trials import stored_trials

    given = {name: found.trials for name, found in others.items()}
    if not given and options.outcomes and (stored := stored_trials(forecaster)) is not None:
        given = {"stored": stored}
    out: dict[str, Any] = {}
    for name, trials in given.items():
        table = threshold_table(trials, costs_of(options), seed=options.seed)
        # Of a single scene, blocks of frames are held out in turn.
        seen = _SEEN[name] if table.scenes > 1 else _SEEN[name].replace("scene", "block of frames")
        print_thresholds(table, options, seen)
        out[name] = table.as_dict()
    return out


def _training_data(
    options: argparse.Namespace, inputs: Inputs, logged: Recorded | None
) -> TrainingData:
    """Read the training data; adds to the notes what some instances lack."""
    from dataclasses import replace

    from graspcast.errors import InputError
    from graspcast.estimates.loading import load_outcomes
    from graspcast.forecasting.learned_loading import load_learned
    from graspcast.forecasting.simulated_trials import SimulatedTrials
    from graspcast.forecasting.training_data import TrainingData
    from graspcast.forecasting.view_data import fuse_for_training

    if not (options.outcomes or options.simulated or logged):
        raise InputError(
            "there are neither outcomes nor simulated trials to learn from; where no real trials "
            "were made, graspcast simulate gives a campaign's directory of them",
            parameters=("outcomes", "simulated"),
        )
    needed = _needed(options, inputs)
    several = len(needed) > 1
    if several and options.images:
        raise InputError(
            "images are looked at with one estimator alone: they add nothing to a consensus, so "
            "leave out --images, or the other estimators"
        )
    estimates = inputs.estimates(options.principal, only=needed if options.learn_from else None)
    outcomes = None if logged is None else logged.outcomes
    if options.outcomes:
        outcomes = load_outcomes(options.outcomes, estimates.estimators)
    simulated = None
    if options.simulated:
        simulated = SimulatedTrials.read(options.simulated, options.gripper)
    truth = None
    motions = motions_of(options, inputs) if logged is None else logged.motions
    if options.method in ("blend", "two-stage") and (several or motions):
        truth = inputs.truth(estimates, options.principal)
    data = TrainingData.join(
        estimates, outcomes, options.principal, options.gripper, truth=truth, simulated=simulated
    )
    if outcomes is not None and (untried := int((~data.is_tried).sum())):
        inputs.notes.append(f"{counted(untried, 'instance', 'has', 'have')} no outcome")
    if truth is not None and (unknown := int((~data.has_truth).sum())):
        inputs.notes.append(f"{counted(unknown, 'instance', 'has', 'have')} no ground truth")
    data = load_learned(inputs, data, outcomes, options.learn_from)
    if motions:
        if options.method not in ("blend", "two-stage"):
            raise InputError(
                f"the method {options.method} does not forecast with several views; blend and "
                "two-stage do",
                parameters=("method", "camera_poses"),
            )
        rules = fusion_options(options)
        views = fuse_for_training(inputs, motions, estimates, options.principal, **rules)
        data = replace(data, views=views)
    return data


def _needed(options: argparse.Namespace, inputs: Inputs) -> tuple[str, ...]:
    """Return the estimators that the model will need, those that are only learned from left out."""
    from graspcast.forecasting.learned_outcomes import check_names
    from graspcast.forecasting.one_estimator import check_learned

    check_names(options.learn_from, options.principal, inputs.estimators)
    needed = tuple(name for name in inputs.estimators if name not in options.learn_from)
    alone, views = len(needed) == 1, bool(options.camera_poses)
    given = options.learn_from, options.principal, options.method
    check_learned(*given, alone=alone, views=views)
    return needed


def _figure(value: float | int | None) -> str:
    return f"{value:.3f}" if isinstance(value, float) else "-" if value is None else str(value)
