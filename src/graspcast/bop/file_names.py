"""Names of results files, and the datasets that they state.

``METHOD_DATASET-SPLIT[-SPLITTYPE][_ID].csv``, as the BOP Challenge has it
(https://github.com/thodan/bop_toolkit, ``inout.parse_result_filename``). Methods and datasets may
hold hyphens and underscores themselves, and anything may be the ID, so that some names can be read
in several ways.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from os import PathLike
from pathlib import Path

from graspcast.errors import InputError, MismatchError

__all__ = ["belongs_to", "datasets_in", "split_in", "swapped_names"]

_SPLIT = re.compile(r"-(?:train|val|test|onboarding)(?![A-Za-z])", re.IGNORECASE)
_SPLIT_AND_TYPE = re.compile(r"(?:train|val|test|onboarding)(?:-[a-z][a-z0-9]*)?(?![a-z0-9])")
_OTHER_SPLIT = re.compile(r"-(?=[A-Za-z])")
_UUID = re.compile(r"_[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}(?![0-9a-f])", re.IGNORECASE)


def datasets_in(path: str | PathLike[str]) -> tuple[str, ...]:
    """Parse the datasets that a results file's name may state, the likeliest first.

    A dataset stands between an underscore and a hyphen that is followed by the split. Where some
    hyphen is followed by a split of BOP's (``train``, ``val``, ``test``, ``onboarding``), only
    those count. The likeliest dataset is the shortest before the first split.

    Returns
    -------
    One name, several where the file's name is ambiguous, none where it states no dataset.
    """
    after_method, without_method = _readings(path)
    return after_method or without_method[:1]


def _readings(path: str | PathLike[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the datasets that may follow a method, and those that may be the name's beginning."""
    stem = _UUID.sub("", _stem(path))
    ends = [found.start() for found in _SPLIT.finditer(stem)]
    if not ends:
        # No hyphen within a dataset whose split is not known.
        ends = [f.start() for f in _OTHER_SPLIT.finditer(stem) if "_" in stem[: f.start()]]
        parts = [_names_before(stem, end) for end in ends]
        return tuple(dict.fromkeys(n for p in parts for n in p if "-" not in n)), ()
    parts = [
        [name for name in _names_before(stem, end) if not _SPLIT.search(f"{name}.")] for end in ends
    ]
    after_method = tuple(dict.fromkeys(name for part in parts for name in part))
    whole = [stem[:end] for end, part in zip(ends, parts, strict=True) if part or not after_method]
    return after_method, tuple(name for name in whole if _is_name(name))


def _stem(path: str | PathLike[str]) -> str:
    """Return a file's name without its ending, ``.csv`` or ``.csv.gz``."""
    name = Path(path).name
    return Path(name[: -len(".gz")] if name.lower().endswith(".gz") else name).stem


def _names_before(stem: str, end: int) -> list[str]:
    """Return what stands between each underscore and a split, the shortest first."""
    starts = [i + 1 for i, letter in enumerate(stem[:end]) if letter == "_" and i]
    return [name for start in reversed(starts) if _is_name(name := stem[start:end])]


def _is_name(text: str) -> bool:
    """Whether a dataset may be called so: it holds a letter, so is no date, and begins well."""
    return text[:1].isalnum() and any(letter.isalpha() for letter in text)


def belongs_to(path: str | PathLike[str], datasets: Collection[str]) -> tuple[str, bool]:
    """Return the dataset that a results file is of, and whether the file's name says so.

    Parameters
    ----------
    path
        The file; it is not read.
    datasets
        The datasets' names of which there are directories; the file must be of one of these, unless
        there are none. They decide where its name can be read in several ways, and a file whose
        name states none is of the only one.

    Raises
    ------
    InputError
        If the name states no dataset, or may mean several.
    MismatchError
        If it states another one.
    """
    likely, beginnings = _readings(path)
    readings = likely or beginnings[:1]
    possible = {name.casefold() for name in (*likely, *beginnings)}
    found = [name for name in datasets if name.casefold() in possible]
    if len(found) == 1:
        return found[0], True
    said = f"by its name a CSV of dataset {' or '.join(found or readings)}"
    rename = "name the file METHOD_DATASET-SPLIT.csv, without another underscore"
    if found:
        raise InputError(
            f"{path}: {said}, and there are BOP directories of each; {rename}",
            parameters=("estimates", "bop"),
        )
    if not datasets:
        if len(readings) == 1:
            return readings[0], True
        which = f" It is {said}." if readings else ""
        raise InputError(
            f"{path}: of which dataset?{which} N{rename[1:]}, or give the BOP directory",
            parameters=("bop",),
        )
    if readings:
        raise MismatchError(
            f"{path}: {said}, but the BOP directories are of {', '.join(datasets)}; if one of "
            f"them is the same, name it so: {readings[0]}=DIR",
            parameters=("bop",),
        )
    if len(datasets) == 1:
        return next(iter(datasets)), False
    raise InputError(
        f"{path}: of which dataset, {' or '.join(datasets)}? N{rename[1:]}",
        parameters=("estimates",),
    )


def split_in(path: str | PathLike[str], dataset: str) -> str:
    """Return the split that a results file's name states, as BOP's directories are called.

    Parameters
    ----------
    path
        The file; it is not read.
    dataset
        The dataset that it is of.

    Returns
    -------
        ``test``, ``val`` or, with its type, ``test_primesense``; empty if it states none.

    Examples
    --------
    >>> split_in("m_tless-test-primesense_7c9f443f.csv", "tless")
    'test_primesense'
    """
    after = _UUID.sub("", _stem(path)).casefold().rpartition(f"{dataset.casefold()}-")[2]
    found = _SPLIT_AND_TYPE.match(after)
    return found[0].replace("-", "_") if found else ""


def swapped_names(files: Sequence[tuple[str, Path]]) -> list[str]:
    """Return a warning for each estimator whose file is named after another of the estimators.

    Parameters
    ----------
    files
        Estimators' names and their files, which are not read.
    """
    names = {name for name, _ in files}
    methods = [(name, path, _stem(path).partition("_")[0]) for name, path in files]
    return [
        f"Warning: {path}, named after {method}, is given as estimates by {name}"
        for name, path, method in methods
        if method != name and method in names and "_" in _stem(path)
    ]
