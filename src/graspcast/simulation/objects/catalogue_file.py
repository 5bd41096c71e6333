"""Writing of a catalogue of objects: entries are added to a TOML file, and the others stay."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from graspcast.errors import FormatError
from graspcast.io.files import write_text
from graspcast.io.reading import MAX_TEXT_BYTES, read_text
from graspcast.io.toml import read_toml
from graspcast.simulation.objects.catalogue import ObjectEntry, objects_in
from graspcast.simulation.objects.decomposition import Decomposition

__all__ = ["entry_table", "known_tables", "update_catalogue"]

_HEADER = "# Objects for graspcast: an entry per object, made by graspcast add-object.\n"


def entry_table(entry: ObjectEntry, mesh: str | None) -> dict[str, Any]:
    """Return the TOML table of an entry.

    Parameters
    ----------
    entry
        The entry, with a decomposition for its collision shape.
    mesh
        Its mesh in millimetres, as the file is to name it; None for that of its BOP dataset.
    """
    table: dict[str, Any] = {"label": entry.label, "dataset": entry.dataset, "obj_id": entry.obj_id}
    if mesh is not None:
        table |= {"mesh": mesh, "unit": "mm"}
    table |= {
        "mass_kg": entry.mass_kg,
        "mass_source": entry.mass_source,
        "friction": entry.friction,
        "friction_source": entry.friction_source,
        "up": [float(x) for x in entry.up],
    }
    how, usual = entry.collision, Decomposition()
    if isinstance(how, Decomposition):
        changed = {k: v for k, v in vars(how).items() if v != getattr(usual, k)}
        table["collision"] = {"pieces": how.pieces, **changed}
    return table | ({} if entry.inertia == "mesh" else {"inertia": entry.inertia})


def known_tables(path: Path) -> dict[str, dict[str, Any]]:
    """Read the entries of a catalogue as tables, by name; none if there is no such file.

    Raises
    ------
    FormatError
        If it is no catalogue.
    """
    if not path.exists():
        return {}
    objects_in(path)
    tables: dict[str, dict[str, Any]] = read_toml(path)["objects"]
    return tables


def update_catalogue(path: Path, tables: Mapping[str, Mapping[str, Any]]) -> None:
    """Write entries into a catalogue, atomically; all else in the file stays as it is.

    Raises
    ------
    FormatError
        If an entry to be replaced is not written as a table of its own, ``[objects.NAME]``.
    """
    known = known_tables(path)
    text = read_text(path, MAX_TEXT_BYTES) if path.exists() else _HEADER
    for name, table in tables.items():
        block = _block(name, table)
        if name not in known:
            text = f"{text.rstrip()}\n\n{block}"
        elif known[name] != table:
            header = rf"^\[objects\.(?:{re.escape(name)}|{re.escape(json.dumps(name))})\][^\n]*\n"
            found = re.search(rf"{header}(?:(?!\[)[^\n]*\n?)*", text, re.MULTILINE)
            if found is None:
                raise FormatError(
                    path, f"should have [objects.{name}] on a line of its own; change it by hand"
                )
            text = f"{text[: found.start()]}{block}\n{text[found.end() :]}".rstrip() + "\n"
    write_text(path, text)


def _block(name: str, table: Mapping[str, Any]) -> str:
    key = name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name)
    lines = [f"{k} = {_value(v)}" for k, v in table.items()]
    return "\n".join([f"[objects.{key}]", *lines, ""])


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_value(v)}" for k, v in value.items()) + " }"
    # JSON's texts, numbers, booleans and lists of numbers are TOML's, too.
    return json.dumps(value, ensure_ascii=False)
