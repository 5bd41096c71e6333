"""The verb ``compare``: which estimator should be the principal, and which supporters help."""

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

    from graspcast.evaluation.estimator_comparison import Comparison, SupporterComparison
    from graspcast.evaluation.paired_differences import PairedDifference

__all__ = ["add"]

_TITLES = {
    "aurc": "AURC",
    "auroc": "AUROC",
    "brier": "Brier",
    "success_at_50": "50 %",
    "success_at_70": "70 %",
    "success_at_90": "90 %",
    "success": "100 %",
}


def add(verbs: Verbs) -> None:
    """Add the verb ``compare``."""
    verb = new_verb(
        verbs,
        "compare",
        _compare,
        "which estimator should be principal, and which supporters help",
        "Cross-validate forecasts with each estimator that has outcomes as the principal: with\n"
        "all supporters, without each, and with each alone. No forecaster is trained on the scene\n"
        "of the instances that it forecasts. Differences have 95 % intervals from a bootstrap\n"
        "over scenes.\n\n"
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
        help="folds of scenes, 2 or more (default: 5)",
    )
    verb.add_argument(
        "--method",
        choices=("blend", "direct"),
        default="blend",
        help="as for train; direct needs no ground truth (default: blend)",
    )
    verb.add_argument(
        "--bootstrap",
        metavar="N",
        type=positive,
        default=1000,
        help="number of draws of scenes (default: 1000)",
    )
    verb.add_argument("--seed", metavar="N", type=int, default=0, help="of everything random")
    add_json(verb)


def _compare(options: argparse.Namespace) -> None:
    from graspcast.estimates.loading import load_outcomes
    from graspcast.evaluation.estimator_comparison import compare
    from graspcast.evaluation.principal_forecasts import principal_training_data
    from graspcast.evaluation.recommendation import recommendation
    from graspcast.forecasting.models.blend import ForestSettings

    inputs = inputs_of(options)
    # Before outcomes are read: two estimators are needed, whatever the outcomes are.
    estimators = inputs.estimates().estimators
    outcomes = load_outcomes(options.outcomes, estimators)
    training_data = principal_training_data(
        inputs, outcomes, options.gripper, with_truth=options.method == "blend"
    )
    note(*inputs.notes, *inputs.lengths)
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
    text = recommendation(found)
    _print(found)
    print_text(f"{text}.")
    write_json(options.json, {"compare": {**found.as_dict(), "recommendation": text}})


def _print(found: Comparison) -> None:
    from graspcast.evaluation.paired_differences import CRITERION, PRINCIPAL_MEASURES

    for principal in found.principals.values():
        _print_principal(principal, found.gripper)
    if len(found.common_scores) > 1:
        rows = []
        best, *_ = found.ranking
        for name in found.ranking:
            row = [name, *_cells(found.common_scores[name], PRINCIPAL_MEASURES)]
            better = "-" if name == best else f"{found.improvement[best, name][CRITERION]:+}"
            rows.append([*row, better])
        print_table(
            f"principals on the {found.common} instances tried with each, of {found.scenes} scenes",
            [
                "principal",
                *(_TITLES[name] for name in PRINCIPAL_MEASURES),
                f"improvement by {best} (AURC)",
            ],
            rows,
        )
    settings = found.settings
    print_text(
        "AURC: failure rate of attempts, averaged over all attempt rates. 50, 70, 90, 100 %: "
        "success rate of that share with the highest probabilities.\nIn brackets: 95 % intervals, "
        f"{settings['bootstrap']} draws of scenes; with few scenes they are somewhat too narrow. "
        f"Forests of {settings['forests']['trees']} trees, not calibrated.\n"
    )


def _print_principal(found: SupporterComparison, gripper: str) -> None:
    from graspcast.evaluation.paired_differences import FORECAST_MEASURES

    rows = [["all", *_cells(found.scores, FORECAST_MEASURES), "-", "-"]]
    rows += _rows("without", found.without)
    # Of two supporters, one without the other is it alone.
    if len(found.alone) > 2:
        rows += _rows("only", found.alone)
    header = ["supporters", *(_TITLES[name] for name in FORECAST_MEASURES)]
    left_out = ""
    if found.without_forecast:
        left_out = f", without {found.without_forecast} of objects in no other scene"
    print_table(
        f"{found.principal} as principal, {gripper} gripper: {found.n} instances of "
        f"{found.scenes} scenes{left_out}; success rate {found.success_rate:.3f} if all are "
        "attempted",
        [*header, "improvement by all (AURC)", "(AUROC)"],
        rows,
    )


def _rows(word: str, differences: Mapping[str, PairedDifference]) -> list[list[str]]:
    from graspcast.evaluation.paired_differences import FORECAST_MEASURES

    return [
        [
            f"{word} {name}",
            *_cells(difference.scores, FORECAST_MEASURES),
            f"{difference.improvement['aurc']:+}",
            f"{difference.improvement['auroc']:+}",
        ]
        for name, difference in differences.items()
    ]


def _cells(scores: Mapping[str, float], names: tuple[str, ...]) -> list[str]:
    return [f"{scores[name]:.3f}" for name in names]
