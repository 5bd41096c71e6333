from __future__ import annotations

from pathlib import Path

import pytest

from graspcast.errors import FormatError, InputError
from graspcast.simulation.objects.catalogue import read_catalogue
from mug import MUG


def test_the_catalogue_has_the_papers_objects_with_their_sources() -> None:
    catalogue = read_catalogue()
    expected = {f"lmo-{i}" for i in (1, 5, 6, 8, 9, 10, 11, 12)}
    expected |= {f"ycbv-{i}" for i in (2, 3, 4, 5, 8, 9, 12)}
    assert set(catalogue) == expected
    for name, entry in catalogue.items():
        assert name == f"{entry.dataset}-{entry.obj_id}"
        assert (entry.ycb is not None) == (entry.dataset == "ycbv")
        assert entry.mass_source and entry.friction_source
        assert entry.dataset == "ycbv" or entry.mass_source.startswith("estimated")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass_kg = 0.3", "mass_kg = 0", r"objects.mug: mass_kg is 0.0, and must be .* above zero"),
        ("friction = 0.6", "friction = -1", "friction is -1.0"),
        ("friction = 0.6", "friction = nan", "friction is nan"),
        ("friction = 0.6", "friction = 60", "friction is 60.0, .* from 0 to 3"),
        ("mass_kg = 0.3", "mass_kg = 'heavy'", "mass_kg should be a number, not 'heavy'"),
        ("mass_kg = 0.3", "", "mass_kg is missing"),
        ("mass_kg = 0.3", "mass_kg = 0.3\nmas = 1", r"unknown key 'mas' \(did you mean"),
        ('mesh = "mug.stl"', "", "mesh is missing; name a file, or a dataset"),
        ("up = [0, 0, 1]", "up = [0, 1]", "up should be 3 finite numbers"),
        ("pieces = 1", "pieces = 0", "collision: a collision shape needs at least one piece"),
        ("pieces = 1", "piece = 1", "unknown key 'piece'"),
        ("pieces = 1", "primitives = []", "primitives is empty"),
        ("pieces = 1", "primitives = [{kind='cone', size_m=[1]}]", "kind is 'cone'; known: box"),
        ("pieces = 1", "primitives = [{kind='box', size_m=[1, 2]}]", "size_m should be 3"),
        ("pieces = 1", "primitives = [{kind='sphere', size_m=[0]}]", "size_m is"),
        ("[objects.mug]", "[object.mug]", r"has no \[objects.NAME\] table"),
        ("[objects.mug]", "[objects.mug", "is not TOML"),
    ],
)
def test_a_catalogue_that_is_wrong(mug: Path, old: str, new: str, message: str) -> None:
    mug.write_text(MUG.replace(old, new))
    with pytest.raises(FormatError, match=message):
        read_catalogue(mug)


def test_a_name_comes_before_a_label_and_a_label_of_two_is_refused(mug: Path) -> None:
    other = MUG.replace("[objects.mug]", '[objects."my mug"]')
    mug.write_text(MUG + other)
    catalogue = read_catalogue(mug)
    assert catalogue["my mug"].name == "my mug"
    mug.write_text(MUG + MUG.replace("[objects.mug]", "[objects.cup]"))
    with pytest.raises(InputError, match=r"2 objects have the label 'my mug'.* mug, cup"):
        read_catalogue(mug)["my mug"]
