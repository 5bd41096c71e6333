"""Reproduction of the paper's Tables I to III, and of Table III by other protocols."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from importlib.resources import files
from typing import Any

import numpy as np
import polars as pl

from graspcast.bop.results import read_results
from graspcast.estimates.error_tables import measure
from graspcast.forecasting.features import consensus_features, mean_add
from graspcast.forecasting.models.add_threshold import fit_thresholds, predict_below
from graspcast.io.arguments import a, checked
from graspcast.io.progress import Progress, step_of
from graspcast.paper.configurations import CONFIGURATIONS, Cell, CellKey, run
from graspcast.paper.dataset import DATASETS, ESTIMATORS, GRIPPERS, OBJECTS, Published
from graspcast.paper.release import read_add_differences

__all__ = ["paper_tables", "reproduce", "table1", "table2", "table3_baseline", "table3_networks"]

Averages = dict[str, Any]
"""Gripper to the average over principals, and ``by_principal``."""


def paper_tables() -> dict[str, Any]:
    """Return the paper's Tables I to III as printed; None where the paper has a dash."""
    text = files("graspcast.paper").joinpath("paper_tables.json").read_text(encoding="utf-8")
    tables: dict[str, Any] = json.loads(text)
    return tables


def table1(outcomes: pl.DataFrame) -> dict[str, dict[str, dict[str, float | None]]]:
    """Compute the success rate of each object, estimator and gripper, over all trials."""
    rates = outcomes.group_by("dataset", "obj_id", "estimator", "gripper").agg(
        pl.col("success").mean()
    )
    found = {(f"{d}-{o}", e, g): rate for d, o, e, g, rate in rates.rows()}
    return {
        name: {e: {g: found.get((name, e, g)) for g in GRIPPERS} for e in ESTIMATORS}
        for name in OBJECTS
    }


def table2(data: Published) -> dict[str, dict[str, dict[str, float]]]:
    """Compute each estimator's mean rotation and translation error and success rate over objects.

    As in the paper, over all estimates of an estimator, not only over the instances that all three
    found, and including the identity poses that stand for 'nothing found'.
    """
    rates = table1(data.outcomes)
    out: dict[str, dict[str, dict[str, float]]] = {}
    for dataset in DATASETS:
        names = [name for name in OBJECTS if name.startswith(f"{dataset}-")]
        for estimator in ESTIMATORS:
            results = read_results(data.results_path(estimator, dataset), placeholders=True)
            wanted = np.isin(results.obj_id, [int(n.split("-")[1]) for n in names])
            errors = measure(results.select(wanted), data.bop[dataset], only=_TABLE2_MEASURES)
            means = errors.group_by("obj_id").mean()
            row = {m: float(np.mean(means[m].to_numpy())) for m in _TABLE2_MEASURES}
            for gripper in GRIPPERS:
                found = [rates[name][estimator][gripper] for name in names]
                row[gripper] = float(np.mean([rate for rate in found if rate is not None]))
            out.setdefault(dataset, {})[estimator] = row
    return out


_TABLE2_MEASURES = ("rotation_deg", "translation_mm")


def _cells(data: Published) -> dict[CellKey, Cell]:
    cells = {}
    for principal, gripper in _pairs():
        tried, part = data.tried(principal, gripper)
        used = part != ""
        tried, part = tried.select(used), part[used]
        values = consensus_features(tried.estimates, principal).values
        objects, success = tried.objects, tried.own_success == 1
        for name in (n for n in OBJECTS if n in set(objects.tolist())):
            mine = objects == name
            is_train = part[mine] == "train"
            cells[principal, name, gripper] = Cell(values[mine], success[mine], is_train)
    return cells


def _pairs() -> Iterator[tuple[str, str]]:
    yield from ((p, g) for p in ESTIMATORS for g in GRIPPERS)


def _average(accuracy: Mapping[CellKey, float]) -> Averages:
    """Average over objects for each principal and gripper, then over principals."""
    by_principal: dict[str, dict[str, float]] = {}
    for principal, gripper in _pairs():
        mine = [a for (p, _, g), a in accuracy.items() if (p, g) == (principal, gripper)]
        by_principal.setdefault(principal, {})[gripper] = float(np.mean(mine))
    out: Averages = {g: float(np.mean([by_principal[p][g] for p in ESTIMATORS])) for g in GRIPPERS}
    return out | {"by_principal": by_principal}


def baseline_accuracy(
    data: Published, released: Mapping[tuple[str, str, int, int, int], float] | None = None
) -> dict[CellKey, float]:
    """Compute the test accuracy of the ADD threshold in each cell.

    Parameters
    ----------
    data
        The published data.
    released
        The authors' own mean ADD by (principal, dataset, scene, image, object); by default ADD is
        computed from the object models.
    """
    out: dict[CellKey, float] = {}
    for principal, gripper in _pairs():
        tried, part = data.tried(principal, gripper)
        estimates, objects, success = tried.estimates, tried.objects, tried.own_success == 1
        if released is None:
            disagreement = mean_add(estimates, principal, data.models)
        else:
            keys = [key[:4] for key in estimates.instances.to_keys()]
            disagreement = np.array([released[principal, *key] for key in keys])
        train, test = part == "train", part == "test"
        thresholds = fit_thresholds(disagreement[train], success[train], objects[train])
        correct = predict_below(disagreement, thresholds, objects) == success
        for name in thresholds:
            out[principal, name, gripper] = float(correct[test & (objects == name)].mean())
    return out


def table3_baseline(data: Published) -> tuple[Averages, dict[str, Any]]:
    """Compute the baseline's averages, and compare ADD from the meshes with the authors' values.

    The released ADD differences are used where ``raw/`` has them, else ADD from the meshes.
    """
    ours = baseline_accuracy(data)
    if data.release is None:
        return _average(ours), {"add": "from the object models"}
    theirs = baseline_accuracy(data, read_add_differences(data.release))
    deviating = {
        "/".join(key): {"released": theirs[key], "meshes": ours[key]}
        for key in theirs
        if ours[key] != theirs[key]
    }
    note = {"add": "as released", "meshes": _average(ours), "deviating_cells": deviating}
    return _average(theirs), note


def table3_networks(
    cells: Mapping[CellKey, Cell],
    seeds: int,
    progress: Progress | None = None,
) -> dict[str, dict[str, Averages]]:
    """Average each network configuration by protocol; each figure is the mean over seeds."""
    truth = {key: cell.success[~cell.is_train] for key, cell in cells.items()}
    out: dict[str, dict[str, Averages]] = {}
    for i, (name, configuration) in enumerate(CONFIGURATIONS.items()):
        accuracy: dict[str, dict[CellKey, list[float]]] = {}
        for seed in range(seeds):
            step = step_of(
                progress, i * seeds + seed, len(CONFIGURATIONS) * seeds, f"training {name}"
            )
            found = run(configuration, cells, seed=seed, progress=step)
            for protocol, probabilities in found.items():
                by_cell = accuracy.setdefault(protocol, {})
                for key, probability in probabilities.items():
                    correct = (probability > 0.5) == truth[key]
                    by_cell.setdefault(key, []).append(float(correct.mean()))
        out[name] = {
            protocol: _average({key: float(np.mean(values)) for key, values in cell.items()})
            for protocol, cell in accuracy.items()
        }
    return out


@checked(data=a(Published))
def reproduce(
    data: Published,
    *,
    seeds: int = 1,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Compute Tables I, II and III from the published data.

    Parameters
    ----------
    data
        The published data.
    seeds
        Number of seeds with which networks are trained.
    progress
        Called with the share of the training that is done and a message.

    Returns
    -------
        ``table1.<object>.<estimator>.<gripper>``, ``table2.<dataset>.<estimator>.<measure>``,
        ``table3.<method>.<protocol>.<gripper>``, and ``baseline``, ``majority``, ``seeds``,
        ``seconds``.
    """
    start = time.perf_counter()
    baseline, note = table3_baseline(data)
    table3: dict[str, Any] = {"baseline": {"fitted": baseline}}
    cells = _cells(data)
    table3 |= table3_networks(cells, seeds, progress)
    return {
        "table1": table1(data.outcomes),
        "table2": table2(data),
        "table3": table3,
        "baseline": note,
        "majority": _average(_majority(cells)),
        "seeds": seeds,
        "seconds": time.perf_counter() - start,
    }


def _majority(cells: Mapping[CellKey, Cell]) -> dict[CellKey, float]:
    """Compute the test accuracy of each cell's more frequent training outcome."""
    out = {}
    for key, cell in cells.items():
        guess = cell.success[cell.is_train].mean() >= 0.5
        out[key] = float((cell.success[~cell.is_train] == guess).mean())
    return out
