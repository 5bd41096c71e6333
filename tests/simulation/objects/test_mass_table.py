from __future__ import annotations

from pathlib import Path

import pytest

from graspcast.errors import FormatError
from graspcast.simulation.objects.mass_table import MassTable
from graspcast.simulation.objects.new_object import Told


def table(tmp_path: Path, text: str) -> MassTable:
    (tmp_path / "masses.csv").write_text(text)
    return MassTable(tmp_path / "masses.csv")


def test_rows_by_file_name_stem_or_number(tmp_path: Path) -> None:
    masses = table(
        tmp_path,
        "object,mass_kg,friction,label\nmug.stl,0.3,0.5,a mug\nbowl,0.2,,\n7,0.1,,\nlid,1,,\n",
    )
    mug = masses.told(Path("a/mug.stl"), 1, Told(density=900.0))
    assert (mug.mass_kg, mug.density, mug.mass_source) == (0.3, None, "masses.csv")
    assert (mug.friction, mug.friction_source, mug.label) == (0.5, "masses.csv", "a mug")
    bowl = masses.told(Path("bowl.ply"), 2, Told(friction=0.4))
    assert (bowl.mass_kg, bowl.friction, bowl.label) == (0.2, 0.4, None)
    assert masses.told(Path("obj_000007.ply"), 7, Told()).mass_kg == 0.1
    assert masses.unused == ["lid"]
    assert masses.told(Path("cup.ply"), 9, Told(density=900.0)).density == 900.0
    with pytest.raises(FormatError, match=r"no row for cup.ply \(object 9\), and no density"):
        masses.told(Path("cup.ply"), 9, Told())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("object,mass\nmug,1\n", "no column 'mass_kg'"),
        ("object,mass_kg,weight\nmug,1,2\n", "the column 'weight'"),
        ("object,mass_kg\nmug,1\nmug,2\n", "line 3: 'mug' is listed twice"),
        ("object,mass_kg\nmug,nan\n", "line 2: mass_kg is 'nan'"),
        ("object,mass_kg\nmug,-1\n", "line 2: mass_kg is -1"),
        ("object,mass_kg\nmug,\n", "line 2: mass_kg is None"),
        ("object,mass_kg,friction\nmug,1,x\n", "line 2: friction is 'x'"),
    ],
)
def test_a_table_that_is_wrong(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(FormatError, match=said):
        table(tmp_path, text)
