from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from graspcast.errors import FormatError
from graspcast.simulation.objects.catalogue import ObjectEntry, read_catalogue
from graspcast.simulation.objects.catalogue_file import (
    entry_table,
    known_tables,
    update_catalogue,
)
from graspcast.simulation.objects.decomposition import Decomposition

MUG = ObjectEntry(
    name="kit-3",
    label='a "mug"',
    mass_kg=0.31,
    mass_source="weighed",
    friction=0.6,
    friction_source="a guess",
    up=(0.0, 0.0, 1.0),
    collision=Decomposition(pieces=5, preprocess=False),
    dataset="kit",
    obj_id=3,
    inertia="pieces",
)
BY_HAND = """# mine
[objects.mug] # by hand
mesh = "mug.stl"
mass_kg = 0.31
mass_source = "weighed"
friction = 0.6
friction_source = "a guess"
up = [0, 0, 1]

# the end
"""


def test_an_entry_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "objects.toml"
    update_catalogue(path, {"kit-3": entry_table(MUG, None)})
    assert read_catalogue(path)["kit-3"] == MUG
    update_catalogue(path, {"kit-4": entry_table(replace(MUG, name="kit-4"), "models/a.ply")})
    entry = read_catalogue(path)["kit-4"]
    assert entry.mesh == tmp_path / "models/a.ply" and entry.unit == "mm"


def test_what_is_there_stays_and_an_entry_is_replaced_in_its_place(tmp_path: Path) -> None:
    path = tmp_path / "objects.toml"
    path.write_text(BY_HAND)
    update_catalogue(path, {"kit-3": entry_table(MUG, None)})
    update_catalogue(path, {"kit-5": entry_table(replace(MUG, obj_id=5), None)})
    assert path.read_text().startswith(BY_HAND.rstrip())
    update_catalogue(path, {"kit-3": entry_table(replace(MUG, mass_kg=0.5), None)})
    tables = known_tables(path)
    assert list(tables) == ["mug", "kit-3", "kit-5"]
    assert tables["kit-3"]["mass_kg"] == 0.5 and tables["kit-5"]["mass_kg"] == 0.31
    assert path.read_text().startswith(BY_HAND.rstrip())


def test_an_entry_that_is_no_table_of_its_own_is_left_to_its_author(tmp_path: Path) -> None:
    path = tmp_path / "objects.toml"
    inline = ", ".join(line for line in BY_HAND.splitlines()[2:8])
    path.write_text(f"[objects]\nkit-3 = {{ {inline} }}\n")
    before = path.read_text()
    with pytest.raises(FormatError, match="change it by hand"):
        update_catalogue(path, {"kit-3": entry_table(MUG, None)})
    assert path.read_text() == before
