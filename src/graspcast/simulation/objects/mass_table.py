"""Table of masses: a CSV with the mass, and if known friction and label, of many objects."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any

from graspcast.errors import FormatError
from graspcast.io.numerals import plain
from graspcast.io.tables import read_csv
from graspcast.simulation.objects.new_object import Told

__all__ = ["MassTable"]

_REQUIRED, _OPTIONAL = ("object", "mass_kg"), ("friction", "label")


class MassTable:
    """Masses of objects by file name or number.

    Parameters
    ----------
    path
        A CSV with the columns ``object`` (the mesh's file name, with or without its suffix, or the
        object's number) and ``mass_kg``, and if wanted ``friction`` and ``label``.

    Raises
    ------
    FormatError
        If a column is missing or unknown, an object is listed twice, or a number is none; the
        message names the line.
    """

    def __init__(self, path: Path):
        self.path = path
        frame = read_csv(path)
        for name in _REQUIRED:
            if name not in frame.columns:
                raise FormatError(path, f"has no column {name!r}; it has {frame.columns}")
        if unknown := sorted(set(frame.columns) - {*_REQUIRED, *_OPTIONAL}):
            known = ", ".join((*_REQUIRED, *_OPTIONAL))
            raise FormatError(path, f"has the column {unknown[0]!r}; known: {known}")
        self._rows: dict[str, dict[str, Any]] = {}
        for line, row in enumerate(frame.iter_rows(named=True), 2):
            name = str(row["object"]).strip()
            if name in self._rows:
                raise FormatError(path, f"line {line}: {name!r} is listed twice")
            self._rows[name] = {
                "mass_kg": self._number(row, "mass_kg", line),
                "friction": self._number(row, "friction", line) if row.get("friction") else None,
                "label": row.get("label"),
            }
        self._used: set[str] = set()

    def _number(self, row: dict[str, Any], key: str, line: int) -> float:
        try:
            value = float(plain(row[key]))
        except (TypeError, ValueError):
            value = float("nan")
        if not (isfinite(value) and value > 0):
            raise FormatError(
                self.path, f"line {line}: {key} is {row[key]!r}, and must be a number above zero"
            )
        return value

    def told(self, mesh: Path, obj_id: int, told: Told) -> Told:
        """Return what is told of an object, with its row of the table.

        Raises
        ------
        FormatError
            If it has no row, and no density is told that would serve instead.
        """
        names = (mesh.name, mesh.stem, str(obj_id))
        name = next((n for n in names if n in self._rows), None)
        if name is None:
            if told.density is None:
                raise FormatError(
                    self.path,
                    f"has no row for {mesh.name} (object {obj_id}), and no density is given",
                    parameters=("density",),
                )
            return told
        self._used.add(name)
        row = self._rows[name]
        told = replace(told, mass_kg=row["mass_kg"], density=None, mass_source=self.path.name)
        if row["friction"] is not None:
            told = replace(told, friction=row["friction"], friction_source=self.path.name)
        return told if row["label"] is None else replace(told, label=str(row["label"]))

    @property
    def unused(self) -> list[str]:
        """Names in the table that no mesh has had."""
        return sorted(set(self._rows) - self._used)
