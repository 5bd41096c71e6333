"""The verb ``compare``: which estimator should be the principal, and which supporters help."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_table, print_text
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
from graspcast.cli.progress import progress_bar
from graspcast.cli.view_options import add_views, fusion_options, motions_of
from graspcast.errors import InputError
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from graspcast.estimates.loading import Inputs
    from graspcast.evaluation.estimator_comparison import Comparison, SupporterComparison
    from graspcast.evaluation.paired_differences import PairedDifference
    from graspcast.evaluation.principal_views import PrincipalViews, Seen
    from graspcast.evaluation.view_worth import Gain, ViewWorth
    from graspcast.forecasting.training_data import TrainingData

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
        "Forests are smaller than those of train and are not calibrated, to save time.\n\n"
        "With camera poses of several images of a scene, it also says what a second view is worth\n"
        "beside what a second estimator is worth.",
    )
    add_inputs(verb)
    verb.add_argument("--gripper", metavar="NAME", required=True, help="whose outcomes to use")
    add_outcomes(verb, required=True)
    add_views(
        verb,
        views_from="all",
        max_views="compare up to this many images an instance, its own included (default: 3)",
        why="; with them, forecasts from several views are compared too (default: single views)",
    )
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
    views = _views(options, inputs, training_data)
    note(*inputs.notes, *inputs.lengths)
    with progress_bar("cross-validating") as move:
        found = compare(
            training_data,
            models=inputs.models,
            forests=ForestSettings(trees=options.trees, folds=0, seed=options.seed),
            folds=options.folds,
            seed=options.seed,
            bootstrap=options.bootstrap,
            views=views,
            progress=move,
        )
    text = recommendation(found)
    _print(found)
    print_text(f"{text}.")
    write_json(options.json, {"compare": {**found.as_dict(), "recommendation": text}})


def _views(
    options: argparse.Namespace, inputs: Inputs, training_data: Sequence[TrainingData]
) -> dict[str, PrincipalViews] | None:
    """Fuse the views of each principal's instances; None without camera poses."""
    from graspcast.evaluation.principal_views import fuse_principals

    if not (motions := motions_of(options, inputs)):
        return None
    if options.method == "direct":
        raise InputError(
            "the method direct does not forecast with several views; blend does",
            parameters=("method", "camera_poses"),
        )
    rules = fusion_options(options)
    with progress_bar("fusing views") as move:
        return fuse_principals(
            inputs, motions, training_data, max_views=options.max_views, progress=move, **rules
        )


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
    for worth in found.views.values():
        _print_views(worth, found.gripper)
    if found.views:
        print_text(
            "Further views: every grasp is guided by the principal's pose from one view, so only "
            "the forecast changes; that a fused pose\nguides better is not counted. From one view "
            "of one estimator there is no forecast.\n"
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


def _print_views(found: ViewWorth, gripper: str) -> None:
    from graspcast.evaluation.paired_differences import FORECAST_MEASURES

    first = (found.estimators, 1)
    rows = []
    for seen in sorted(found.scores, key=lambda seen: (seen[1], len(seen[0]))):
        over = found.over_one_view[seen]
        gains = ["-", "-"] if seen == first else [f"{over[k]:+}" for k in ("aurc", "auroc")]
        rows.append([_told(seen, found), *_cells(found.scores[seen], FORECAST_MEASURES), *gains])
    print_table(
        f"{found.principal} as principal, {gripper} gripper, several views: {found.n} instances of "
        f"{found.scenes} scenes, without {found.without_views} that have fewer views; success rate "
        f"{found.success_rate:.3f} if all are attempted",
        [
            "forecast from",
            *(_TITLES[name] for name in FORECAST_MEASURES),
            "improvement on all, 1 view (AURC)",
            "(AUROC)",
        ],
        rows,
    )
    each = (found.instead, found.others, found.further)
    print_table(
        f"{found.principal} as principal: further views beside further estimators",
        ["forecast from", "compared with", "improvement (AURC)", "(AUROC)"],
        [_gain_row(gain, found) for gains in each for gain in gains.values()],
    )
    if any(found.contradicted.values()):
        counts = ", ".join(f"{n} of {v} views" for v, n in found.contradicted.items() if n)
        print_text(
            f"{found.principal} alone has no forecast where its views contradict each other "
            f"({counts}): these are attempted last.\n"
        )


def _gain_row(gain: Gain, found: ViewWorth) -> list[str]:
    sides = [_told(seen, found) for seen in (gain.better, gain.worse)]
    return [*sides, *(f"{gain.improvement[name]:+}" for name in ("aurc", "auroc"))]


def _told(seen: Seen, found: ViewWorth) -> str:
    names, views = seen
    who = " and ".join(names) if len(names) > 1 else f"{names[0]} alone"
    who = "all" if names == found.estimators else who
    return f"{who}, {counted(views, 'view')}"


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
