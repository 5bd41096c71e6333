"""The verb ``evaluate``: all methods under all protocols."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspcast.cli.console import note, print_text
from graspcast.cli.options import Verbs, add_json, add_outcomes, new_verb, positive, write_json
from graspcast.cli.progress import progress_bar
from graspcast.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from graspcast.evaluation.benchmark import Benchmark
    from graspcast.evaluation.bootstrap import Bootstrap
    from graspcast.evaluation.net_benefit import Costs
    from graspcast.io.progress import Progress
    from graspcast.paper.dataset import Published

__all__ = ["add"]

_DRAWN = "unseen_scenes"


def add(verbs: Verbs) -> None:
    """Add the verb ``evaluate``."""
    verb = new_verb(
        verbs,
        "evaluate",
        _evaluate,
        "compare all methods under every protocol",
        "Train and test every method under every protocol, and print scores with confidence\n"
        "intervals, paired differences and net benefit as Markdown. With --work, an interrupted\n"
        "run can be resumed.",
    )
    verb.add_argument(
        "--data",
        metavar="DIR",
        type=Path,
        required=True,
        help="holds published/ (what import-release writes) and bop/",
    )
    add_outcomes(
        verb,
        required=False,
        what="outcomes of your own simulated trials (a campaign's directory), for methods that "
        "use simulation and for the protocol unseen_object_simulated; may be repeated",
    )
    verb.add_argument(
        "--transferred",
        metavar="DIR",
        type=Path,
        action="append",
        default=[],
        help="trials by errors transferred from other objects (simulate --transferred-errors), "
        "on which two-stage is trained for an object or gripper without outcomes; may be repeated",
    )
    verb.add_argument("--methods", metavar="NAME", nargs="+", help="default: all")
    verb.add_argument(
        "--protocols",
        metavar="NAME",
        nargs="+",
        help="default: all (unseen_object_simulated only with --outcomes, "
        "several_views_unseen_object only with --transferred)",
    )
    _add_cost_options(verb)
    verb.add_argument(
        "--bootstrap",
        metavar="N",
        type=positive,
        default=1000,
        help="bootstrap draws of scenes for intervals (default: 1000)",
    )
    verb.add_argument("--seed", metavar="N", type=int, default=0, help="of everything random")
    verb.add_argument(
        "--work", metavar="DIR", type=Path, help="save forecasts here, and resume from them"
    )
    _add_figure_options(verb)
    add_json(verb)


def _add_cost_options(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--failure-cost",
        metavar="X",
        type=float,
        default=2.0,
        help="cost of a failed attempt, in units of the gain of a success (default: 2)",
    )
    verb.add_argument(
        "--abstain-cost",
        metavar="X",
        type=float,
        default=0.2,
        help="cost of not attempting, in the same units (default: 0.2)",
    )


def _add_figure_options(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--figures",
        metavar="DIR",
        type=Path,
        help="write a reliability diagram and risk-coverage curves, as SVG and PNG (needs "
        "graspcast[plot] and the protocol unseen_scenes)",
    )
    verb.add_argument(
        "--draw", metavar="NAME", nargs="+", help="the methods in figures (default: all evaluated)"
    )


def _chosen(kind: str, asked: list[str] | None, known: list[str]) -> list[str]:
    """Return the requested names, each once, or all."""
    for name in asked or []:
        if name not in known:
            raise UnknownNameError(kind, name, known)
    return list(dict.fromkeys(asked or known))


def _protocols(options: argparse.Namespace) -> tuple[list[str], list[str]]:
    """Return the requested protocols, and those of them with several views apart."""
    from graspcast.evaluation.protocols import PROTOCOLS
    from graspcast.evaluation.view_protocols import VIEW_PROTOCOLS

    chosen = _chosen("protocol", options.protocols, [*PROTOCOLS, *VIEW_PROTOCOLS])
    if not (options.outcomes or options.protocols):
        chosen.remove("unseen_object_simulated")
    if not (options.transferred or options.protocols):
        chosen.remove("several_views_unseen_object")
    return [n for n in chosen if n in PROTOCOLS], [n for n in chosen if n in VIEW_PROTOCOLS]


def _benchmark(options: argparse.Namespace) -> tuple[Benchmark, Published]:
    """Read the published data, and one's own trials if there are any."""
    from graspcast.estimates.outcomes import read_all_outcomes
    from graspcast.evaluation.benchmark import Benchmark
    from graspcast.forecasting.simulated_trials import SimulatedTrials
    from graspcast.paper.dataset import Published

    simulated = read_all_outcomes(options.outcomes) if options.outcomes else None
    data = Published(options.data)
    note(*data.lengths)
    transferred = {}
    if options.transferred:
        transferred = {
            gripper: SimulatedTrials.read(options.transferred, gripper)
            for gripper in data.outcomes["gripper"].unique().sort().to_list()
        }
    return Benchmark.of(data, simulated, transferred), data


def _with_views(
    data: Published,
    benchmark: Benchmark,
    protocols: list[str],
    costs: Costs,
    bootstrap: Bootstrap,
    options: argparse.Namespace,
    move: Progress,
) -> dict[str, Any]:
    """Fuse the published estimates, and evaluate forecasts with several views."""
    from dataclasses import replace

    from graspcast.evaluation.view_fusion import fuse_benchmark, published_sources
    from graspcast.evaluation.view_report import evaluate_views, rows_of
    from graspcast.evaluation.view_sets import view_rows

    rows = rows_of(protocols, view_rows(benchmark.estimates.estimators))
    sources = published_sources(data, seed=options.seed)
    views = fuse_benchmark(sources, benchmark.estimates, rows, progress=move)
    return evaluate_views(
        replace(benchmark, views=views),
        protocols,
        rows,
        costs=costs,
        bootstrap=bootstrap,
        work=options.work,
        seed=options.seed,
        progress=move,
    )


def _evaluate(options: argparse.Namespace) -> None:
    import inspect
    import time
    from dataclasses import asdict

    from graspcast.evaluation.bootstrap import Bootstrap
    from graspcast.evaluation.methods import METHODS
    from graspcast.evaluation.net_benefit import Costs
    from graspcast.evaluation.protocols import PROTOCOLS
    from graspcast.evaluation.report import evaluate
    from graspcast.evaluation.run import forecast_all
    from graspcast.evaluation.tables import render_evaluation
    from graspcast.evaluation.view_tables import render_views
    from graspcast.io.provenance import versions

    start = time.perf_counter()
    costs = Costs(options.failure_cost, options.abstain_cost)
    bootstrap = Bootstrap(options.bootstrap, options.seed)
    protocols, with_views = _protocols(options)
    names = _chosen("method", options.methods, list(METHODS))
    drawn = _chosen("method to draw", options.draw, names)
    if options.figures is not None:
        if _DRAWN not in protocols:
            raise InputError(f"figures are of the protocol {_DRAWN}; add it to --protocols")
        from graspcast.io.extras import require

        require("plot")
    methods = {name: METHODS[name](options.seed) for name in names}
    benchmark, data = _benchmark(options)
    forecasts, scores, views = [], dict[str, Any](), dict[str, Any]()
    with progress_bar("evaluating") as move:
        if protocols:
            forecasts = forecast_all(
                benchmark, methods, protocols, work=options.work, seed=options.seed, progress=move
            )
            scores = evaluate(forecasts, costs=costs, bootstrap=bootstrap, progress=move)
        if with_views:
            views = _with_views(data, benchmark, with_views, costs, bootstrap, options, move)
    found = {
        **scores,
        "several_views": views,
        "protocols": {name: PROTOCOLS[name] for name in protocols},
        "methods": {n: (inspect.getdoc(m) or "").partition("\n")[0] for n, m in methods.items()},
        "settings": {name: repr(method) for name, method in methods.items()},
        "costs": costs.of_one_look(),
        "bootstrap": {**asdict(bootstrap), "unit": "scene, or block of frames of an only scene"},
        "seed": options.seed,
        "data": benchmark.digest(own_trials=True),
        "versions": versions("numba", "scikit-learn", "scipy"),
        "seconds": time.perf_counter() - start,
    }
    if protocols:
        print_text(render_evaluation(found))
    if with_views:
        print_text(render_views(views))
    if options.figures is not None:
        from graspcast.evaluation.figures import draw_figures

        for path in draw_figures(forecasts, options.figures, methods=drawn, bootstrap=bootstrap):
            note(f"{path}, and the same as PNG")
    write_json(options.json, found)
