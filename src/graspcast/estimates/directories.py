"""BOP directories that estimates belong to: named, and opened at the split of the estimates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from graspcast.bop.dataset import BopDataset
from graspcast.bop.file_names import split_in
from graspcast.bop.scenes import find_split
from graspcast.errors import InputError, MismatchError
from graspcast.io.arguments import PATH, refuse_unless, sequence

__all__ = ["NamedDirectory", "named_directories", "open_directories"]


@dataclass(frozen=True)
class NamedDirectory:
    """A BOP directory.

    Attributes
    ----------
    name
        The dataset's name.
    root
        The directory.
    ground_truth
        The directory of the scene folders, None for a split of ``root``.
    """

    name: str
    root: Path
    ground_truth: Path | None = None


def named_directories(
    bop: Sequence[str | PathLike[str] | tuple[str | None, str | PathLike[str]]],
    ground_truth: Sequence[str | PathLike[str]] = (),
) -> dict[str, NamedDirectory]:
    """Name BOP directories; they are not read.

    Parameters
    ----------
    bop
        Directories, or pairs of a name and a directory that is called otherwise.
    ground_truth
        Directories of scene folders, none or one for each, in their order.

    Raises
    ------
    InputError
        If two have one name, one is no directory, or the ground truth is of another number.
    """
    words = "a directory, or a pair of a name and a directory"
    roots = sequence((lambda root: isinstance(root, str | PathLike | tuple), words))
    refuse_unless(roots, bop, "load_inputs", "bop")
    refuse_unless(sequence(PATH), ground_truth, "load_inputs", "ground_truth")
    if len(ground_truth) not in (0, len(bop)):
        raise InputError(
            f"{len(ground_truth)} directories of ground truth for {len(bop)} BOP directories: give "
            "none, or one for each, in the same order",
            parameters=("ground_truth", "bop"),
        )
    out: dict[str, NamedDirectory] = {}
    for i, entry in enumerate(bop):
        given, path = (None, entry) if isinstance(entry, str | PathLike) else entry
        root = Path(path)
        if not root.is_dir():
            BopDataset(root)  # says that it is none
        name = given or root.resolve().name
        if name in out:
            raise InputError(
                f"{root}: there is already a dataset {name}, {out[name].root}; name one of them "
                "otherwise, NAME=DIR",
                parameters=("bop",),
            )
        out[name] = NamedDirectory(name, root, Path(ground_truth[i]) if ground_truth else None)
    return out


def open_directories(
    named: Mapping[str, NamedDirectory],
    files: Iterable[tuple[Path, str]],
    sensor: str | None = None,
) -> dict[str, BopDataset]:
    """Open each directory at the split that the names of its estimates' files state.

    Parameters
    ----------
    named
        The directories by dataset.
    files
        Results files and the datasets that they are of.
    sensor
        The camera, where there are several.

    Returns
    -------
        Dataset's name to the dataset. A split that the directory lacks is not looked for: the
        estimates may be of images that are elsewhere.

    Raises
    ------
    MismatchError
        If files of one dataset are of several splits that the directory has.
    """
    splits: dict[str, dict[str, Path]] = {}
    for path, of in files:
        directory = named.get(of)
        if directory is not None and directory.ground_truth is None:
            split = split_in(path, of)
            if split and find_split(directory.root, split).is_dir():
                splits.setdefault(of, {}).setdefault(split, path)
    for of, found in splits.items():
        if len(found) > 1:
            says = ", ".join(f"{path} of {split}" for split, path in found.items())
            raise MismatchError(
                f"estimates of {of} are of several splits: {says}; give those of one",
                parameters=("estimates", "ground_truth"),
            )
    return {
        name: BopDataset(
            directory.root,
            ground_truth=directory.ground_truth,
            split=next(iter(splits.get(name, ())), None),
            name=name,
            sensor=sensor,
        )
        for name, directory in named.items()
    }
