"""Files of a run: given one by one, or recognised in a directory."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from os import PathLike
from pathlib import Path

import polars as pl

from graspcast.diagnosis.discovery import discover, method_of
from graspcast.errors import FormatError, InputError

__all__ = ["MOST_FILES", "RunFiles", "find_run"]

MOST_FILES = 2000
"""A directory with more files than this is no run's."""
_HEAD = 4096
_COMMANDS = "commands.sh"
_DIGITS = re.compile(r"(\d+)")


@dataclass(frozen=True)
class RunFiles:
    """The files that a report is made of; what there is none of is empty.

    Attributes
    ----------
    name
        Of the run, as headings show it.
    directory
        Where the files were found; None if they were given one by one.
    verdicts, stages
        What ``predict`` wrote: verdicts, in the order of the number of looks; and verdicts after
        each look.
    outcomes
        Outcomes of trials: tables, and directories of campaigns.
    estimates
        Names of estimators and their results.
    bop, ground_truth
        BOP directories, with names where they are called otherwise, and scene folders.
    models, certificates, tolerances
        What ``train``, ``certify`` and ``tolerance --json`` wrote.
    commands
        The commands that made the run; None if they are not recorded.
    """

    name: str
    directory: Path | None = None
    verdicts: tuple[Path, ...] = ()
    stages: tuple[Path, ...] = ()
    outcomes: tuple[Path, ...] = ()
    estimates: tuple[tuple[str, Path], ...] = ()
    bop: tuple[tuple[str | None, Path], ...] = ()
    ground_truth: tuple[Path, ...] = ()
    models: tuple[Path, ...] = ()
    certificates: tuple[Path, ...] = ()
    tolerances: tuple[Path, ...] = ()
    commands: Path | None = None

    def with_given(self, given: RunFiles) -> RunFiles:
        """Return these files, and in place of each kind that was given, what was given of it."""
        kinds = (f.name for f in fields(self) if f.name not in ("name", "directory"))
        return replace(self, **{k: value for k in kinds if (value := getattr(given, k))})

    def shown(self, path: str | PathLike[str]) -> str:
        """Return a path as the report shows it: from the run's directory, or the name alone."""
        path = Path(path)
        if self.directory is not None and path.is_relative_to(self.directory):
            return path.relative_to(self.directory).as_posix()
        return path.name or str(path)


def find_run(directory: str | PathLike[str]) -> RunFiles:
    """Recognise the files of a run in a directory, and in those below it.

    Files are told by what they hold. Hidden ones, and what is nothing that a report shows, are left
    out.

    Raises
    ------
    InputError
        If it is no directory, has too many files, or none that is known.
    """
    directory = Path(directory)
    if not directory.is_dir():
        what = "is a file" if directory.exists() else "no such directory"
        raise InputError(
            f"{directory}: {what}; a run is a directory, whose files are recognised; name files "
            "one by one instead",
            parameters=("verdicts", "stages"),
        )
    found: dict[str, list[Path]] = {}
    for kind, path in _walk(directory, [0], directory):
        found.setdefault(kind, []).append(path)
    if not found:
        raise InputError(
            f"{directory}: holds nothing that a report shows: verdicts, outcomes, results files, a "
            "model, certificates or tolerances",
            parameters=("verdicts", "stages"),
        )
    names: list[str] = []
    for path in found.get("results", ()):
        names.append(method_of(path, names))
    one = {kind: tuple(sorted(paths, key=_natural)) for kind, paths in found.items()}
    return RunFiles(
        name=directory.resolve().name or str(directory),
        directory=directory,
        estimates=tuple(zip(names, found.get("results", ()), strict=True)),
        bop=tuple((None, path) for path in one.get("bop", ())),
        commands=next(iter(one.get("commands", ())), None),
        **{
            kind: one.get(kind, ())
            for kind in ("verdicts", "stages", "outcomes", "models", "certificates", "tolerances")
        },
    )


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key: numbers in names count as numbers."""
    parts = _DIGITS.split(path.as_posix())
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _walk(directory: Path, seen: list[int], root: Path) -> Iterator[tuple[str, Path]]:
    """Yield the kind and path of each file or directory that a report shows."""
    try:
        children = sorted(directory.iterdir(), key=_natural)
    except OSError as error:
        raise FormatError(directory, f"cannot be read ({error.strerror})") from error
    for child in children:
        if child.name.startswith("."):
            continue
        seen[0] += 1
        if seen[0] > MOST_FILES:
            raise InputError(
                f"{root}: holds more than {MOST_FILES} files; is it a run's directory? Name the "
                "files one by one instead",
                parameters=("verdicts", "stages"),
            )
        if child.is_dir():
            if (child / "manifest.json").is_file():
                yield "outcomes", child
            elif (child / "camera.json").is_file() or (child / "models").is_dir():
                yield "bop", child
            elif not child.is_symlink():
                yield from _walk(child, seen, root)
        elif child.is_file() and (kind := _kind(child)):
            yield kind, child


def _kind(path: Path) -> str:
    """Return what a file is, as :class:`RunFiles` calls it; empty for what is not known."""
    suffix = path.suffix.lower()
    if path.name == _COMMANDS:
        return "commands"
    if suffix == ".npz":
        return "models" if _is_model(path) else ""
    if suffix == ".json":
        head = _head(path)
        if '"at_true_pose"' in head and '"gripper"' in head:
            return "tolerances"
        return "certificates" if '"guarantees"' in head else ""
    if suffix == ".csv":
        columns = {name.strip() for name in _head(path).partition("\n")[0].split(",")}
        if columns >= {"verdict", "est_id", "probability"}:
            return "stages" if columns >= {"looks", "ended"} else "verdicts"
    if suffix == ".parquet" and not _is_parquet(path):
        return "outcomes"
    found, _ = discover([path])
    kinds = {"results": "results", "outcomes": "outcomes"}
    return kinds.get(found[0].kind, "") if found else ""


def _is_model(path: Path) -> bool:
    """Whether a file is a model, or a damaged archive, which is to be said, not passed over."""
    try:
        with zipfile.ZipFile(path) as archive:
            return "card.npy" in archive.namelist()
    except OSError:
        return False
    except zipfile.BadZipFile:
        return True


def _is_parquet(path: Path) -> bool:
    """Whether a file is one of Parquet; a damaged one is to be said, not passed over."""
    try:
        pl.read_parquet_schema(path)
    except (OSError, pl.exceptions.PolarsError):
        return False
    return True


def _head(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            return stream.read(_HEAD).decode("utf-8-sig", errors="replace")
    except OSError:
        return ""
