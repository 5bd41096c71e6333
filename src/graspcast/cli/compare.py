"""The verb ``compare``: which estimator should be the principal, what each supporter is worth."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table, print_text, progress_bar
from graspcast.cli.options import (
    Verbs,
    add_inputs,
    add_json,
    add_outcomes,
    inputs_of,
    new_verb,
    positive,
    write_json,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from graspcast.estimates.loading import Inputs
    from graspcast.evaluation.estimator_comparison import Comparison, Judged
    from graspcast.evaluation.paired_differences import PairedDifference
    from graspcast.forecasting.training_data import TrainingData

__all__ = ["add"]

_TITLES = {
    "aurc": "AURC",
    "auroc": "AUROC",
    "brier": "Brier",
    "success_at_50": "50 %",
    "success_at_70": "70 %",
    "success_at_90": "90 %",
    "success": "all",
}


def add(verbs: Verbs) -> None:
    """Add the verb ``compare``."""
    verb = new_verb(
        verbs,
        "compare",
        _compare,
        "which estimator should be principal, and what each supporter is worth",
        "Forecast, for each estimator that has outcomes as the principal, every instance by\n"
        "a forecaster that saw nothing of its scene: with all supporters, without each, and with\n"
        "each alone. Differences have 95 % intervals from draws of scenes with replacement.\n\n"
        "Forests are smaller than those of train and are not calibrated, to save time.",
    )
    add_inputs(verb)
    verb.add_argument("--gripper", metavar="NAME", required=True, help="whose outcomes to use")
    add_outcomes(verb, required=True)
    verb.add_argument(
        "--trees", metavar="N", type=positive, default=64, help="of each forest (default: 64)"
    )
    verb.add_argument(
        "--folds",
        metavar="N",
        type=positive,
        default=5,
        help="parts that scenes are dealt into, 2 or more (default: 5)",
    )
    verb.add_argument(
        "--bootstrap",
        metavar="N",
        type=positive,
        default=1000,
        help="draw the scenes so often (default: 1000)",
    )
    verb.add_argument("--seed", metavar="N", type=int, default=0, help="of everything random")
    add_json(verb)


def _compare(options: argparse.Namespace) -> None:
    from graspcast.evaluation.estimator_comparison import compare
    from graspcast.forecasting.models.blend import ForestSettings

    inputs = inputs_of(options)
    training_data = _lessons(options, inputs)
    note(*inputs.notes)
    with progress_bar("cross-validating") as move:
        found = compare(
            training_data,
            models=inputs.models,
            forests=ForestSettings(trees=options.trees, folds=0, seed=options.seed),
            folds=options.folds,
            seed=options.seed,
            bootstrap=options.bootstrap,
            progress=move,
        )
    _print(found)
    write_json(options.json, {"compare": found.as_dict()})


def _lessons(options: argparse.Namespace, inputs: Inputs) -> list[TrainingData]:
    """Those of each estimator that has outcomes with the gripper."""
    from graspcast.errors import MismatchError, UnknownNameError
    from graspcast.estimates.loading import load_outcomes
    from graspcast.forecasting.training_data import TrainingData

    # Before outcomes are read: a consensus takes two, whatever they say.
    names = inputs.estimates().estimators
    outcomes = load_outcomes(options.outcomes, names)
    grippers = outcomes["gripper"].unique().sort().to_list()
    if options.gripper not in grippers:
        raise UnknownNameError("gripper", options.gripper, grippers, hint="These have outcomes")
    found = []
    for name in names:
        estimates = inputs.estimates(name)
        truth = inputs.truth(estimates, name)
        try:
            learned = TrainingData.join(estimates, outcomes, name, options.gripper, truth=truth)
            untried = int((~learned.is_tried).sum())
        except MismatchError as error:
            inputs.notes.append(f"{error}: it is a supporter only")
            continue
        if untried:
            inputs.notes.append(f"{untried} instances have no outcome of {name}")
        found.append(learned)
    if not found:
        raise MismatchError(
            f"no instance has an outcome of {', '.join(names)} with the {options.gripper} gripper; "
            "are the outcomes of the same dataset and scenes as the estimates?"
        )
    return found


def _print(found: Comparison) -> None:
    from graspcast.evaluation.paired_differences import STANDING

    for judged in found.principals.values():
        _print_principal(judged, found.gripper)
    if len(found.standings) > 1:
        rows = []
        best, *_ = found.ranking
        for name in found.ranking:
            row = [name, *_figures(found.standings[name], STANDING)]
            rows.append(
                [*row, "-" if name == best else format(found.ahead[best, name]["aurc"], "+")]
            )
        print_table(
            f"principals on the {found.common} instances tried with each, of {found.scenes} scenes",
            ["principal", *(_TITLES[name] for name in STANDING), f"{best} is better by (AURC)"],
            rows,
        )
    settings = found.settings
    print_text(
        "AURC: share of attempts that fail, over all attempt rates alike. 50, 70, 90 %: success "
        "rate of that most probable share.\nIn brackets: 95 % intervals, "
        f"{settings['bootstrap']} draws of scenes; there are few, so intervals are rather too "
        f"narrow. Forests of {settings['forests']['trees']} trees, not calibrated.\n"
    )
    print_text(f"{found.recommendation}.")


def _print_principal(judged: Judged, gripper: str) -> None:
    from graspcast.evaluation.paired_differences import FORECAST

    rows = [["all", *_figures(judged.figures, FORECAST), "-", "-"]]
    rows += _rows("without", judged.without)
    # Of two supporters, one without the other is it alone.
    if len(judged.alone) > 2:
        rows += _rows("only", judged.alone)
    header = ["supporters", *(_TITLES[name] for name in FORECAST)]
    lost = f"; {judged.unjudged} of objects in no other scene" if judged.unjudged else ""
    print_table(
        f"{judged.principal} as principal, {gripper} gripper: {judged.n} instances of "
        f"{judged.scenes} scenes{lost}; {judged.success:.3f} hold if all are attempted",
        [*header, "all are better by (AURC)", "(AUROC)"],
        rows,
    )


def _rows(word: str, contrasts: Mapping[str, PairedDifference]) -> list[list[str]]:
    from graspcast.evaluation.paired_differences import FORECAST

    return [
        [
            f"{word} {name}",
            *_figures(contrast.figures, FORECAST),
            format(contrast.gain["aurc"], "+"),
            format(contrast.gain["auroc"], "+"),
        ]
        for name, contrast in contrasts.items()
    ]


def _figures(figures: Mapping[str, float], names: tuple[str, ...]) -> list[str]:
    return [f"{figures[name]:.3f}" for name in names]
