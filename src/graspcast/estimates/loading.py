"""Loading of estimates: results files and the datasets they belong to, checked together."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.file_names import belongs_to, swapped_names
from graspcast.bop.models import Models
from graspcast.bop.results import Results, read_results
from graspcast.errors import (
    FormatError,
    GraspcastError,
    InputError,
    MismatchError,
    UnknownNameError,
)
from graspcast.estimates.alignment import Estimates, align, concatenate
from graspcast.estimates.consistency import check_tables, describe_lengths
from graspcast.estimates.directories import named_directories, open_directories
from graspcast.estimates.matching import true_poses
from graspcast.estimates.outcomes import read_all_outcomes
from graspcast.estimates.parts import put_together
from graspcast.estimates.selection import Selection, check_scenes, known_objects, listed
from graspcast.io.arguments import refuse_unless, sequence

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
    image_fit
        Adds image fit to the estimates of a single estimator
        (:func:`graspcast.rendering.image_fit.with_image_fit`), or None.
    """

    datasets: Mapping[str, BopDataset]
    results: Mapping[str, Mapping[str, Results]]
    notes: list[str] = field(default_factory=list)
    image_fit: Callable[[Estimates], Estimates] | None = None

    def add_notes(self, texts: Iterable[str]) -> None:
        """Add to the notes what they do not yet say."""
        self.notes.extend(text for text in dict.fromkeys(texts) if text not in self.notes)

    @property
    def models(self) -> dict[str, Models]:
        """Dataset's name to its object models."""
        return {name: dataset.models for name, dataset in self.datasets.items()}

    @property
    def lengths(self) -> list[str]:
        """How large objects were read and how far away, one line for each dataset."""
        lines = [
            describe_lengths(
                name, self.datasets.get(name), {e: table.cam_T_obj for e, table in tables.items()}
            )
            for name, tables in self.results.items()
        ]
        return [line for line in lines if line]

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
            # Ground truth that is there, and wrong, is another matter than none.
            if isinstance(error, FormatError) and Path(error.path).exists():
                raise
            if isinstance(error, MismatchError) and "estimates" in error.parameters:
                raise
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
        return self.with_image_fit(together)

    def with_image_fit(self, estimates: Estimates) -> Estimates:
        """Add image fit to the estimates of a single estimator, if there is any."""
        if self.image_fit is None or len(estimates.estimators) > 1:
            return estimates
        return self.image_fit(estimates)


def load_inputs(
    estimates: Mapping[str, str | PathLike[str]] | Sequence[tuple[str, str | PathLike[str]]],
    *,
    bop: Sequence[str | PathLike[str] | tuple[str | None, str | PathLike[str]]] = (),
    ground_truth: Sequence[str | PathLike[str]] = (),
    objects: Sequence[str] = (),
    scenes: Sequence[int] = (),
    lenient: bool = False,
    sensor: str | None = None,
    without_models: bool = False,
) -> Inputs:
    """Read results CSVs and the BOP directories they belong to.

    A file belongs to the dataset that its name states (``METHOD_DATASET-SPLIT.csv``, with whatever
    follows in the names of the BOP Challenge); if it states none, to the only BOP directory. The
    name states the split, too, where the directory has it; otherwise it is ``test``.

    Parameters
    ----------
    estimates
        Estimator's name to its file; or pairs of them, where a name may come several times: for
        several datasets, and for several files of one, which are put together.
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
    sensor
        The camera that took the images, where the BOP directories hold those of several.
    without_models
        Leave out estimates of objects without a model, with a note, instead of raising.

    Raises
    ------
    InputError
        Naming the file, what is wrong, and the remedy: a file of a dataset of which there is no
        BOP directory, an object without a model, no estimate that is wanted.
    """
    pairs = _pairs(estimates)
    named = named_directories(bop, ground_truth)
    wanted = Selection(objects, scenes)
    files = [(name, Path(given), *belongs_to(given, named)) for name, given in pairs]
    datasets = open_directories(named, [(path, of) for _, path, of, _ in files], sensor)
    wanted.check_datasets(dict.fromkeys(of for _, _, of, _ in files))
    out = Inputs(datasets, {})
    out.notes.extend(swapped_names([(name, path) for name, path, _, _ in files]))
    parts: dict[str, dict[str, list[Results]]] = {}
    for name, path, of, stated in files:
        mine = parts.setdefault(of, {}).setdefault(name, [])
        if wanted.numbers(of) == []:
            continue  # an object of another dataset is wanted
        mine.append(read_results(path, lenient=lenient))
        _note_dropped(mine[-1], out.notes)
        if of in datasets and len(mine[-1]):
            note = check_scenes(mine[-1], datasets[of], stated=stated)
            out.notes.extend([note] if note else [])
    tables = {
        of: {name: put_together(name, tables) for name, tables in found.items() if tables}
        for of, found in parts.items()
    }
    results = _chosen(tables, wanted, datasets, lenient or without_models, out.notes)
    for of, found in results.items():
        check_tables(found, datasets[of].models if of in datasets else None)
    return replace(out, results=results)


def _note_dropped(table: Results, notes: list[str]) -> None:
    for why, n in table.dropped.items():
        ranks = "; est_id ranks the rows that are left" if why == "bad row" else ""
        notes.append(f"{table.source}: dropped {n} rows ({why}){ranks}")


def _chosen(
    tables: Mapping[str, Mapping[str, Results]],
    wanted: Selection,
    datasets: Mapping[str, BopDataset],
    without_models: bool,
    notes: list[str],
) -> dict[str, dict[str, Results]]:
    """Return the wanted rows of every file, of objects that the models know.

    A file that holds no estimate at all stays where others hold some; one that has none of the
    wanted ones is an error, unless another dataset has them.
    """
    found: dict[str, dict[str, Results]] = {}
    nothing: list[InputError] = []
    for dataset, files in tables.items():
        rows = {name: wanted.of(table, dataset) for name, table in files.items()}
        without = [wanted.why_none(files[n], dataset) for n, t in rows.items() if not len(t)]
        nothing += without
        if len(without) == len(files):
            continue
        for name, table in rows.items():
            if not len(table) and len(files[name]):
                raise wanted.why_none(files[name], dataset)
            if dataset in datasets:
                known = known_objects(table, datasets[dataset], lenient=without_models)
                if left := len(table) - len(known):
                    numbers = listed(set(table.obj_id.tolist()) - set(known.obj_id.tolist()))
                    notes.append(
                        f"{table.source}: dropped {left} rows (object without a model: {numbers})"
                    )
                rows[name] = known
        found[dataset] = {}
        for name, table in rows.items():
            found[dataset][name] = table
            _check_distinct(name, found[dataset])
    if not found:
        raise (
            nothing[0]
            if nothing
            else InputError("there are no estimates", parameters=("estimates",))
        )
    notes.extend(str(error) for error in nothing)
    notes.extend(f"there is no estimate of object {name}" for name in wanted.lacking_in(found))
    return found


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


def load_outcomes(paths: Sequence[Path], estimators: Sequence[str]) -> pl.DataFrame:
    """Read outcomes from several files or directories as one table.

    Raises
    ------
    InputError
        Naming the file that is wrong, or if there is no outcome.
    UnknownNameError
        If none of the estimators has outcomes.
    """
    table = read_all_outcomes(paths)
    if not len(table):
        raise InputError(
            f"{', '.join(map(str, paths))}: holds no outcome", parameters=("outcomes",)
        )
    known = table["estimator"].unique().sort().to_list()
    if not set(known) & set(estimators):
        raise UnknownNameError(
            "estimator", ", ".join(estimators), known, hint="These have outcomes"
        )
    return table
