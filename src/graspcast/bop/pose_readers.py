"""Readers of poses: which one knows a file, and what the others miss in it."""

from __future__ import annotations

import json
from pathlib import Path

from graspcast.bop.pose_json import MEGAPOSE, SAM6D, megapose_rows, sam6d_rows
from graspcast.bop.pose_matrices import MATRICES, matrix_rows
from graspcast.bop.pose_rows import PoseRows, Stated
from graspcast.bop.results_csv import csv_rows, is_results_csv
from graspcast.bop.results_rows import COLUMNS
from graspcast.errors import FormatError
from graspcast.io.json import read_json
from graspcast.io.reading import read_text

__all__ = ["pose_rows"]

CSV = "BOP results CSV"


def pose_rows(path: Path, stated: Stated) -> PoseRows:
    """Return the rows of a file of poses, whoever wrote it.

    Parameters
    ----------
    path
        The file, or a directory.
    stated
        What it does not say itself.

    Raises
    ------
    FormatError
        If no reader knows the file, with what each of them misses; or from the one that does.
    """
    missed: dict[str, str] = {}
    if path.is_dir():
        missed = dict.fromkeys((CSV, SAM6D, MEGAPOSE), "it is a directory, not a file")
    else:
        text = read_text(path)
        if text.lstrip().startswith(("[", "{")):
            missed[CSV] = "it is JSON"
            found = _json_rows(path, text, stated, missed)
            if found is not None:
                return found
        elif is_results_csv(text):
            rows = list(csv_rows(path, text))
            return PoseRows([r for _, r in rows], [n for n, _ in rows], "line", "mm")
        else:
            first = text.lstrip().partition("\n")[0].strip()
            names = ",".join(COLUMNS)
            missed[CSV] = f"its first line, {first[:40]!r}, is neither {names} nor a row of these"
            missed |= dict.fromkeys((SAM6D, MEGAPOSE), "it is not JSON")
    matrices = matrix_rows(path, stated)
    if isinstance(matrices, PoseRows):
        return matrices
    missed[MATRICES] = matrices
    tried = "; ".join(f"{name}: {why}" for name, why in missed.items())
    raise FormatError(path, f"is in none of the forms of poses that are read. {tried}")


def _json_rows(path: Path, text: str, stated: Stated, missed: dict[str, str]) -> PoseRows | None:
    """Return the rows of a JSON file; None, and what is missed, if they are no poses."""
    try:
        json.loads(text)
    except (ValueError, RecursionError):
        missed |= dict.fromkeys((SAM6D, MEGAPOSE), "it is not valid JSON")
        return None
    entries = read_json(path, object)
    for name, reader in ((SAM6D, sam6d_rows), (MEGAPOSE, megapose_rows)):
        found = reader(entries, path, stated)
        if isinstance(found, PoseRows):
            return found
        missed[name] = found
    return None
