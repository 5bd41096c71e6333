"""Discovery: what the files and directories that were given are."""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Literal

from graspcast.bop.file_names import datasets_in
from graspcast.errors import InputError

__all__ = ["Found", "Kind", "discover", "is_scenes"]

Kind = Literal["models", "scenes", "results", "detections", "outcomes", "camera-poses", "root"]

_HEAD = 4096
_SPLITS = re.compile(r"(train|val|test|onboarding)")
_ROW_IDS = re.compile(r"\s*\d+\s*[,;]\s*\d+\s*[,;]\s*\d+\s*[,;]")


@dataclass(frozen=True)
class Found:
    """A file or directory, and what it is.

    Attributes
    ----------
    kind
        What it is; ``root`` is a dataset's directory with ``camera.json`` or targets.
    path
        Where it is.
    dataset
        The dataset that the name or the directories above it state, or nothing.
    name
        The name it was given, an estimator's for results, or nothing.
    given
        Whether the path itself was given, and not found below a directory.
    """

    kind: Kind
    path: Path
    dataset: str = ""
    name: str = ""
    given: bool = False


def discover(
    paths: Iterable[str | PathLike[str] | tuple[str | None, str | PathLike[str]]],
) -> tuple[list[Found], list[Path]]:
    """Find out what paths are; directories are searched.

    Parameters
    ----------
    paths
        Files and directories, or pairs of a name and one.

    Returns
    -------
        What was recognised, and files that were given but are nothing that is known.

    Raises
    ------
    InputError
        If a path does not exist.
    """
    found: list[Found] = []
    unknown: list[Path] = []
    for entry in paths:
        name, path = entry if isinstance(entry, tuple) else (None, entry)
        path = Path(path)
        if not path.exists():
            raise InputError(f"{path}: no such file or directory", parameters=("paths",))
        if path.is_dir():
            inside = list(_directory(path, name or "", given=True))
            found += inside
            unknown += [] if inside else [path]
        elif kind := _file_kind(path):
            found.append(Found(kind, path, _stated(path), name or "", given=True))
        else:
            unknown.append(path)
    return list({f.path.resolve(): f for f in reversed(found)}.values())[::-1], unknown


def _directory(path: Path, name: str, *, given: bool = False) -> Iterator[Found]:
    """Yield what is in a directory, and in those below it that are nothing by themselves."""
    dataset = name or _dataset_of(path)
    if (path / "models_info.json").is_file():
        yield Found("models", path, name or _parent_name(path), given=given)
        return
    if is_scenes(path):
        yield Found("scenes", path, name or _parent_name(path), given=given)
        return
    if (path / "outcomes.parquet").is_file():
        yield Found("outcomes", path, given=given)
        return
    if (path / "camera.json").is_file():
        yield Found("root", path, dataset, given=given)
    for child in sorted(path.iterdir()):
        if child.name.startswith("."):
            continue
        if child.is_dir():
            yield from _directory(child, name)
        elif kind := _file_kind(child):
            estimator = ""
            yield Found(kind, child, name or _stated(child) or dataset, estimator)


def is_scenes(path: Path) -> bool:
    """Return whether a directory holds scene folders."""
    kinds = ("scene_gt*.json", "scene_camera*.json", "rgb*", "gray*")
    return any(
        child.name.isdecimal() and child.is_dir() and any(any(child.glob(k)) for k in kinds)
        for child in path.iterdir()
    )


def _dataset_of(path: Path) -> str:
    """Return the name of a directory that holds models or scenes; else nothing."""
    children = [c for c in path.iterdir() if c.is_dir()]
    whole = any((c / "models_info.json").is_file() or is_scenes(c) for c in children)
    return path.resolve().name if whole or (path / "camera.json").is_file() else ""


def _parent_name(path: Path) -> str:
    """Return the name of the dataset's directory, in which models and splits stand."""
    return path.resolve().parent.name


def _stated(path: Path) -> str:
    """Return the likeliest dataset that a file's name states, or nothing."""
    return next(iter(datasets_in(path)), "")


def _file_kind(path: Path) -> Kind | None:
    """Return what a file is by its first lines, None for what is not known."""
    suffixes = [s.lower() for s in path.suffixes]
    if path.name in ("models_info.json", "camera.json", "scene_gt.json", "scene_camera.json"):
        return None
    if ".parquet" in suffixes:
        return "outcomes" if _has_outcomes(path) else None
    if ".csv" in suffixes[-2:]:
        return _table_kind(_head(path))
    if ".json" in suffixes[-2:]:
        head = _head(path).lstrip()
        boxed = '"bbox' in head and ('"category_id"' in head or '"obj_id"' in head)
        return "detections" if boxed else None
    return None


def _table_kind(head: str) -> Kind | None:
    first = head.partition("\n")[0]
    columns = {name.strip().strip('"').lower() for name in re.split("[,;]", first)}
    if "success" in columns:
        return "outcomes"
    if {"scene_id", "im_id"} <= columns and any(
        name.startswith(("world_t_cam", "cam_t_world")) for name in columns
    ):
        return "camera-poses"
    if {"scene_id", "im_id", "obj_id", "score"} <= columns or _ROW_IDS.match(first):
        return "results"
    return None


def _head(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            content = stream.read(_HEAD)
        if content[:2] == b"\x1f\x8b":
            with gzip.open(path) as stream:
                content = stream.read(_HEAD)
    except (OSError, EOFError):
        return ""
    return content.decode("utf-8-sig", errors="replace")


def _has_outcomes(path: Path) -> bool:
    """Return whether a Parquet file has a column ``success``; its schema is in its last bytes."""
    try:
        with path.open("rb") as stream:
            stream.seek(max(0, path.stat().st_size - 65536))
            return b"success" in stream.read()
    except OSError:
        return False


def method_of(path: Path, taken: Sequence[str]) -> str:
    """Return the estimator's name that a results file's name begins with, unlike others'."""
    name = path.name.partition(".")[0].partition("_")[0]
    if name in taken:
        name = path.name.partition(".")[0]
    number = 2
    whole = name
    while name in taken:
        name, number = f"{whole}-{number}", number + 1
    return name
