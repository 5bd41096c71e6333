"""Selection of estimates: those of the wanted objects and scenes, held against the dataset."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.errors import FormatError, InputError, MismatchError

__all__ = ["Selection", "check_scenes", "known_objects", "listed"]

_MOST_LISTED = 20


def listed(numbers: Collection[int]) -> str:
    """Format whole numbers for a message, three or more in a row as ``3-8``, at most 20 entries."""
    runs: list[list[int]] = []
    for number in sorted(set(numbers)):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    entries = [f"{run[0]}-{run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs]
    more = ["…"] if len(entries) > _MOST_LISTED else []
    return ", ".join([*entries[:_MOST_LISTED], *more]) or "none"


@dataclass(frozen=True)
class Selection:
    """The wanted objects and scenes.

    Attributes
    ----------
    objects
        ``5``, an object of every dataset, or ``lmo-5``; all if empty.
    scenes
        Numbers; all if empty.

    Raises
    ------
    InputError
        For a name of another form.
    """

    objects: Sequence[str] = ()
    scenes: Sequence[int] = ()

    def __post_init__(self) -> None:
        for name in self.objects:
            dataset, dash, number = name.rpartition("-")
            if not (number.isascii() and number.isdecimal()) or (dash and not dataset):
                raise InputError(
                    f"an object is given as NUMBER, or DATASET-NUMBER (lmo-5), not {name!r}",
                    parameters=("objects",),
                )

    def check_datasets(self, datasets: Collection[str]) -> None:
        """Raise unless some wanted object is of one of the datasets.

        Raises
        ------
        InputError
            Naming the objects.
        """
        named = {name.rpartition("-")[0] for name in self.objects}
        if named and not named & {"", *datasets}:
            raise InputError(
                f"objects {', '.join(self.objects)}: there are only estimates of dataset "
                f"{', '.join(datasets)}",
                parameters=("objects", "estimates"),
            )

    def numbers(self, dataset: str) -> list[int] | None:
        """Return the wanted objects of a dataset, None for all."""
        named = [name.rpartition("-") for name in self.objects]
        found = [int(number) for of, _, number in named if of in ("", dataset)]
        return found if self.objects else None

    def of(self, table: Results, dataset: str) -> Results:
        """Return the wanted rows of a dataset's estimates, perhaps none."""
        keep = np.ones(len(table), dtype=bool)
        if (numbers := self.numbers(dataset)) is not None:
            keep &= np.isin(table.obj_id, numbers)
        if self.scenes:
            keep &= np.isin(table.scene_id, self.scenes)
        return table if keep.all() else table.select(keep)

    def lacking_in(self, results: Mapping[str, Mapping[str, Results]]) -> list[str]:
        """Return the wanted objects that none of the results (by dataset, estimator) has."""
        have = {
            name
            for dataset, tables in results.items()
            for table in tables.values()
            for number in set(table.obj_id.tolist())
            for name in (number, (dataset, number))
        }
        named = {name: name.rpartition("-") for name in self.objects}
        keys = {name: (of, int(n)) if of else int(n) for name, (of, _, n) in named.items()}
        return [name for name, key in keys.items() if key not in have]

    def why_none(self, table: Results, dataset: str) -> InputError:
        """Return the error that nothing of a file is left, which says what it has.

        Parameters
        ----------
        table
            The whole file.
        dataset
            The dataset that it is of.
        """
        if not len(table):
            dropped = ", ".join(f"{n} left out ({why})" for why, n in table.dropped.items() if n)
            return InputError(
                f"{table.source}: holds no estimate" + (f": {dropped}" if dropped else ""),
                parameters=("estimates",),
            )
        wanted, by = [], []
        numbers = self.numbers(dataset)
        if numbers is not None:
            wanted.append(f"of object {listed(numbers)}")
            by.append("objects")
        if self.scenes:
            wanted.append(f"in scene {listed(self.scenes)}")
            by.append("scenes")
        return InputError(
            f"{table.source}: no estimate is left {' '.join(wanted)}; the file has objects "
            f"{listed(table.obj_id.tolist())} in scenes {listed(table.scene_id.tolist())}",
            parameters=by,
        )


def known_objects(table: Results, dataset: BopDataset, *, lenient: bool) -> Results:
    """Return the rows whose objects the dataset has models of.

    Parameters
    ----------
    table
        Estimates.
    dataset
        The dataset that they are of.
    lenient
        Leave the others out and count them in ``dropped["object without a model"]``, instead of
        raising.

    Raises
    ------
    FormatError
        For an object without a model, naming all of them; if lenient, only if no row is left.
    MismatchError
        If lenient, and the dataset has none of the scenes either: these are estimates of another
        one, and what is left of them are other objects with the same numbers.
    """
    info = dataset.models.info
    known = np.isin(table.obj_id, list(info))
    if known.all():
        return table
    if lenient and known.any():
        unknown_scenes, scenes = _unknown_scenes(table, dataset)
        if scenes and unknown_scenes == set(table.scene_id.tolist()):
            raise MismatchError(
                f"{table.source}: neither its scenes ({listed(unknown_scenes)}) nor its objects "
                f"{listed(table.obj_id[~known].tolist())} are in {dataset.root}; these are "
                "estimates of another dataset, whatever the file's name says",
                parameters=("bop", "estimates"),
            )
        count = {"object without a model": int((~known).sum())}
        return replace(table.select(known), dropped={**table.dropped, **count})
    unknown = np.unique(table.obj_id[~known]).tolist()
    them = f"object {listed(unknown)} is" if len(unknown) == 1 else f"objects {listed(unknown)} are"
    line = int(table.line[~known][0])
    remedy = "choose among these, or leave unknown objects out"
    raise FormatError(
        table.source,
        f"{them} not in {dataset.models.directory}/models_info.json, which has "
        f"{listed(list(info))}; "
        + (remedy if known.any() else "are these estimates of another dataset?"),
        where=f"line {line}" if line else None,
        parameters=("objects", "lenient") if known.any() else ("bop", "estimates"),
    )


def check_scenes(table: Results, dataset: BopDataset, *, stated: bool) -> str | None:
    """Hold the scenes of estimates against the scene folders of the dataset, where it has some.

    Parameters
    ----------
    table
        Estimates.
    dataset
        The dataset that they are taken for.
    stated
        Whether the file's name says that they are of this dataset, and not only the lack of another
        one.

    Returns
    -------
    A note on scenes that the dataset lacks, None if there are none.

    Raises
    ------
    MismatchError
        If the dataset has none of the scenes and the file's name does not say that they are of it.
    """
    unknown, known = _unknown_scenes(table, dataset)
    if not known or not unknown:
        return None
    text = (
        f"{table.source}: has estimates of scenes {listed(unknown)}, which are not in "
        f"{dataset.scenes} (it has {listed(known)})"
    )
    if stated or unknown != set(table.scene_id.tolist()):
        return text
    raise MismatchError(
        f"{text}; are they of another dataset or split? If they are of {dataset.name}, name the "
        f"file METHOD_{dataset.name}-SPLIT.csv",
        parameters=("bop", "ground_truth", "estimates"),
    )


def _unknown_scenes(table: Results, dataset: BopDataset) -> tuple[set[int], set[int]]:
    """Return the scenes of estimates that a dataset lacks, and those that it has."""
    if not dataset.scenes.is_dir():
        return set(), set()
    folders = [p.name for p in dataset.scenes.iterdir() if p.name.isdecimal() and p.is_dir()]
    known = {int(name) for name in folders}
    return set(table.scene_id.tolist()) - known, known
