"""Loading of estimates: results files and the datasets they belong to, checked together."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.models import Models
from graspcast.bop.results import Results, dataset_of, read_results
from graspcast.errors import (
    FormatError,
    GraspcastError,
    InputError,
    MismatchError,
    UnknownNameError,
)
from graspcast.estimates.alignment import Estimates, align, concatenate
from graspcast.estimates.matching import true_poses
from graspcast.estimates.outcomes import read_all_outcomes
from graspcast.io.arguments import PATH, refuse_unless, sequence

__all__ = ["Inputs", "load_inputs", "load_outcomes"]


@dataclass(frozen=True)
class Inputs:
    """Results of every estimator on every dataset.

    Attributes
    ----------
    datasets
        Dataset's name to its BOP directory, where one was given.
    results
        Dataset's name to estimator's name to results.
    notes
        What was left out, in words.
    """

    datasets: Mapping[str, BopDataset]
    results: Mapping[str, Mapping[str, Results]]
    notes: list[str] = field(default_factory=list)

    @property
    def models(self) -> dict[str, Models]:
        """Dataset's name to its object models."""
        return {name: dataset.models for name, dataset in self.datasets.items()}

    @property
    def estimators(self) -> tuple[str, ...]:
        """The estimators with results on every dataset."""
        tables = list(self.results.values())
        return tuple(name for name in tables[0] if all(name in table for table in tables))

    @property
    def objects(self) -> set[str]:
        """Names of the objects with estimates, ``dataset-number``."""
        return {
            f"{dataset}-{number}"
            for dataset, tables in self.results.items()
            for table in tables.values()
            for number in set(table.obj_id.tolist())
        }

    def truth(self, estimates: Estimates, principal: str) -> Float[ndarray, "n 4 4"]:
        """Return the true ``cam_T_obj`` of the instances, NaN where unknown, (n, 4, 4).

        Of several instances of an object in an image it is the one that matches the principal's
        estimate.

        Raises
        ------
        InputError
            If not one is known: there is no ground truth, or it is of other images.
        """
        problem = "none of the instances has a known true pose"
        try:
            truth = true_poses(estimates, principal, self.datasets)
            if np.isfinite(truth).any():
                return truth
        except GraspcastError as error:
            problem = str(error)
        raise InputError(
            f"the methods blend and two-stage need ground truth: {problem}; give the datasets' "
            "ground truth, or choose the method direct, which needs none",
            parameters=("ground_truth", "bop", "method"),
        )

    def estimates(
        self, anchor: str | None = None, *, only: Collection[str] | None = None
    ) -> Estimates:
        """Align the estimators (all, or some), and add to :attr:`notes` what some lack.

        Raises
        ------
        MismatchError
            If no instance has a pose by all, or estimators differ among datasets.
        UnknownNameError
            For an anchor that is none of them.
        """
        together = concatenate(
            [
                align(
                    {e: t for e, t in tables.items() if only is None or e in only},
                    dataset=name,
                    anchor=anchor,
                )
                for name, tables in self.results.items()
            ]
        )
        self.notes.extend(together.refused)
        lacking = {name: n for name, n in together.lacking.items() if n}
        if lacking:
            counts = ", ".join(f"{n} by {name}" for name, n in lacking.items())
            self.notes.append(f"dropped instances without an estimate: {counts}")
        return together


def load_inputs(
    estimates: Mapping[str, str | PathLike[str]] | Sequence[tuple[str, str | PathLike[str]]],
    *,
    bop: Sequence[str | PathLike[str] | tuple[str | None, str | PathLike[str]]] = (),
    ground_truth: Sequence[str | PathLike[str]] = (),
    objects: Sequence[str] = (),
    scenes: Sequence[int] = (),
    lenient: bool = False,
) -> Inputs:
    """Read results CSVs and the BOP directories they belong to.

    A file belongs to the dataset that its name states (``METHOD_DATASET-SPLIT.csv``); if it states
    none, to the only BOP directory.

    Parameters
    ----------
    estimates
        Estimator's name to its file; or pairs of them, where a name may come once for each dataset.
    bop
        BOP directories, or pairs of a name and a directory that is called otherwise.
    ground_truth
        Directories of scene folders, one for each BOP directory, in their order.
    objects
        The wanted objects (``5`` or ``lmo-5``), all if empty.
    scenes
        The numbers of the wanted scenes, all if empty.
    lenient
        Skip bad rows and unknown objects.

    Raises
    ------
    InputError
        Naming the file, what is wrong, and the remedy.
    """
    pairs = _pairs(estimates)
    where = "load_inputs"
    words = "a directory, or a pair of a name and a directory"
    roots = sequence((lambda root: isinstance(root, str | PathLike | tuple), words))
    refuse_unless(roots, bop, where, "bop")
    refuse_unless(sequence(PATH), ground_truth, where, "ground_truth")
    if len(ground_truth) not in (0, len(bop)):
        raise InputError(
            f"{len(ground_truth)} directories of ground truth for {len(bop)} BOP directories: give "
            "none, or one for each, in the same order",
            parameters=("ground_truth", "bop"),
        )
    datasets: dict[str, BopDataset] = {}
    for i, entry in enumerate(bop):
        name, root = (None, entry) if isinstance(entry, str | PathLike) else entry
        truth = ground_truth[i] if ground_truth else None
        dataset = BopDataset(root, ground_truth=truth, name=name)
        if dataset.name in datasets:
            raise InputError(
                f"{root}: there is already a dataset {dataset.name}, "
                f"{datasets[dataset.name].root}; name one of them otherwise, NAME=DIR",
                parameters=("bop",),
            )
        datasets[dataset.name] = dataset
    results: dict[str, dict[str, Results]] = {}
    out = Inputs(datasets, results)
    for name, given in pairs:
        path = Path(given)
        dataset_name = _dataset_name(path, datasets)
        tables = results.setdefault(dataset_name, {})
        if name in tables:
            raise InputError(f"{path}: there are already estimates of {dataset_name} by {name}")
        table = read_results(path, lenient=lenient)
        for why, n in table.dropped.items():
            ranks = "; est_id ranks the rows that are left" if why == "bad row" else ""
            out.notes.append(f"{path}: dropped {n} rows ({why}){ranks}")
        if scenes:
            table = _of_scenes(table, scenes)
        tables[name] = _wanted(table, dataset_name, datasets, objects, lenient, out.notes)
        _check_distinct(name, tables)
    return out


def _pairs(estimates: Any) -> list[tuple[str, str | PathLike[str]]]:
    given = list(estimates.items()) if isinstance(estimates, Mapping) else estimates

    def is_pair(pair: Any) -> bool:
        named = isinstance(pair, tuple | list) and len(pair) == 2 and isinstance(pair[0], str)
        return named and isinstance(pair[1], str | PathLike)

    kind = sequence((is_pair, "a name and a path"))
    refuse_unless(kind, given, "load_inputs", "estimates")
    return list(given)


def _check_distinct(name: str, tables: Mapping[str, Results]) -> None:
    """Raise if another estimator has the very same poses: its agreement would say nothing."""
    mine = tables[name]
    for other, table in tables.items():
        same = other != name and len(mine) > 0 and np.array_equal(table.cam_T_obj, mine.cam_T_obj)
        if same and np.array_equal(table.im_id, mine.im_id):
            raise InputError(
                f"{mine.source}: holds the same poses as {table.source}, so {name} and {other} are "
                "one estimator, whose agreement with itself says nothing; give results of others",
                parameters=("estimates",),
            )


def _of_scenes(table: Results, scenes: Sequence[int]) -> Results:
    chosen = np.isin(table.scene_id, scenes)
    if not chosen.any():
        known = ", ".join(map(str, np.unique(table.scene_id).tolist()))
        raise InputError(
            f"{table.source}: no estimate in the wanted scenes {', '.join(map(str, scenes))}; it "
            f"has scenes {known}",
            parameters=("scenes",),
        )
    return table.select(chosen)


def _dataset_name(path: Path, datasets: Mapping[str, BopDataset]) -> str:
    stated = dataset_of(path)
    if not datasets:
        if stated is None:
            raise InputError(
                f"{path}: of which dataset? Name the file METHOD_DATASET-SPLIT.csv, or give the "
                "BOP directory",
                parameters=("bop",),
            )
        return stated
    if stated is None and len(datasets) == 1:
        return next(iter(datasets))
    if stated is None or stated not in datasets:
        raise MismatchError(
            f"{path}: by its name a CSV of dataset {stated}, but the BOP directories are of "
            f"{', '.join(datasets)}; if one of them is the same, name it so: {stated}=DIR",
            parameters=("bop",),
        )
    return stated


def _wanted(
    table: Results,
    dataset_name: str,
    datasets: Mapping[str, BopDataset],
    objects: Sequence[str],
    lenient: bool,
    notes: list[str],
) -> Results:
    """Return the rows of the wanted objects, all of which the models must know."""
    if objects:
        numbers = [int(o.rpartition("-")[2]) for o in objects if _is_of(o, dataset_name)]
        table = table.select(np.isin(table.obj_id, numbers))
    if dataset_name not in datasets:
        return table
    info = datasets[dataset_name].models.info
    known = np.isin(table.obj_id, list(info))
    if known.all():
        return table
    if not lenient:
        row = int(np.flatnonzero(~known)[0])
        raise FormatError(
            table.source,
            f"object {table.obj_id[row]} is not in {datasets[dataset_name].models.directory}"
            f"/models_info.json, which has {', '.join(map(str, sorted(info)))}; choose among "
            "these, or leave unknown objects out",
            where=f"line {table.line[row]}",
            parameters=("objects", "lenient"),
        )
    notes.append(f"{table.source}: dropped {int((~known).sum())} rows (object without a model)")
    return table.select(known)


def _is_of(name: str, dataset_name: str) -> bool:
    dataset, _, number = name.rpartition("-")
    if not number.isdecimal():
        raise InputError(
            f"an object is given as NUMBER, or DATASET-NUMBER (lmo-5), not {name!r}",
            parameters=("objects",),
        )
    return dataset in ("", dataset_name)


def load_outcomes(paths: Sequence[Path], estimators: Sequence[str]) -> pl.DataFrame:
    """Read outcomes from several files or directories as one table.

    Raises
    ------
    InputError
        Naming the file that is wrong.
    UnknownNameError
        If none of the estimators has outcomes.
    """
    table = read_all_outcomes(paths)
    known = table["estimator"].unique().sort().to_list()
    if not set(known) & set(estimators):
        raise UnknownNameError(
            "estimator", ", ".join(estimators), known, hint="These have outcomes"
        )
    return table
