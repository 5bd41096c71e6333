"""Verdicts of a run after each look, put into their order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from graspcast.errors import MismatchError
from graspcast.forecasting.looking import ended_stages
from graspcast.forecasting.stage_file import read_stages
from graspcast.forecasting.verdict import InstanceLooks, VerdictRow
from graspcast.forecasting.verdict_file import read_verdicts

__all__ = ["LookRows", "read_looks"]

Place = tuple[str, int, int, int, str]


@dataclass(frozen=True, eq=False)
class LookRows:
    """Verdicts on the same instances after one look, two, and so on.

    Attributes
    ----------
    paths
        The file of each stage; a file of verdicts after each look is that of all.
    stages
        One verdict for each instance, in the same order at every stage. An instance with fewer
        images keeps its last verdict.
    taken
        How many looks had been taken of each instance by each stage, (stages, n).
    """

    paths: tuple[Path, ...]
    stages: tuple[tuple[VerdictRow, ...], ...]
    taken: Int[ndarray, "s n"]

    @property
    def ended(self) -> Int[ndarray, " n"]:
        """The stage at which looking ended, from 0, by the verdicts."""
        again = np.array(
            [[row.verdict.look is not None for row in stage] for stage in self.stages[:-1]],
            dtype=bool,
        ).reshape(len(self.stages) - 1, len(self.stages[0]))
        return np.asarray(ended_stages(again), dtype=np.int64)


def read_looks(verdicts: Sequence[Path], stages: Sequence[Path]) -> list[LookRows]:
    """Read verdicts, and put files on the same instances after one another by their views.

    Parameters
    ----------
    verdicts
        Files of verdicts. Files on the same instances are the verdicts after one look, two, ...
    stages
        Files of verdicts after each look.

    Returns
    -------
        One for each set of instances.

    Raises
    ------
    FormatError
        For a file that is wrong, naming the line.
    MismatchError
        If two files are on some of the same instances, and not one look after the other.
    """
    out = [_of_stages(path, looks) for path in stages if (looks := read_stages(path))]
    groups: dict[frozenset[Place], list[tuple[Path, list[VerdictRow]]]] = {}
    for path in verdicts:
        if rows := read_verdicts(path):
            groups.setdefault(frozenset(map(_place, rows)), []).append((path, rows))
    out += [_of_files(files) for files in groups.values()]
    _check_apart(out)
    return out


def _of_stages(path: Path, looks: Sequence[InstanceLooks]) -> LookRows:
    taken = np.array([len(each.rows) for each in looks])
    counts = np.stack([np.minimum(taken, k) for k in range(1, int(taken.max()) + 1)])
    stages = tuple(
        tuple(each.rows[k - 1] for each, k in zip(looks, mine.tolist(), strict=True))
        for mine in counts
    )
    return LookRows((path,) * len(stages), stages, counts)


def _of_files(files: list[tuple[Path, list[VerdictRow]]]) -> LookRows:
    files = sorted(files, key=lambda file: max(row.views for row in file[1]))
    most = [max(row.views for row in rows) for _, rows in files]
    for k in range(1, len(files)):
        if most[k] == most[k - 1]:
            raise MismatchError(
                f"{files[k - 1][0]} and {files[k][0]}: both are verdicts on the same instances "
                f"from up to {most[k]} views; give one of them, or report each as a run of its own",
                parameters=("verdicts",),
            )
    # Stable, so that several instances of an object in an image keep the order of the file.
    ordered = [tuple(sorted(rows, key=_place)) for _, rows in files]
    for (path, _), rows in zip(files, ordered, strict=True):
        if list(map(_place, rows)) != list(map(_place, ordered[0])):
            raise MismatchError(
                f"{files[0][0]} and {path}: have different numbers of verdicts on the same objects "
                "and images; give one of them, or report each as a run of its own",
                parameters=("verdicts",),
            )
    taken = np.array([[row.views for row in rows] for rows in ordered], dtype=np.int64)
    return LookRows(tuple(path for path, _ in files), tuple(ordered), taken)


def _check_apart(found: Sequence[LookRows]) -> None:
    """Raise if two are on some of the same instances."""
    seen: dict[Place, Path] = {}
    for looks in found:
        mine = set(map(_place, looks.stages[0]))
        for place in sorted(mine & seen.keys()):
            dataset, scene, image, number = place[:4]
            raise MismatchError(
                f"{seen[place]} and {looks.paths[0]}: both have a verdict on {dataset}-{number} in "
                f"image {scene}/{image}, but are not on the same instances; give one of them, or "
                "report each as a run of its own",
                parameters=("verdicts",),
            )
        seen |= dict.fromkeys(mine, looks.paths[0])


def _place(row: VerdictRow) -> Place:
    """Return whose instance it is, but for ``est_id``, which is each guide's own."""
    return row.key.dataset, row.key.scene_id, row.key.im_id, row.key.obj_id, row.gripper
