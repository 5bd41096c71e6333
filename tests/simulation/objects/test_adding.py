from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from cad_parts import profile
from graspcast.bop.models import Models
from graspcast.errors import GraspcastError, InputError, MismatchError
from graspcast.io.locks import exclusive_lock
from graspcast.simulation.objects import adding
from graspcast.simulation.objects.adding import built_in_ids, find_sources, write_objects
from graspcast.simulation.objects.catalogue import read_catalogue
from graspcast.simulation.objects.load import load_object
from graspcast.simulation.objects.new_object import NewObject, Told, make_object
from poses import write_models


def part(path: Path, *, shift: float = 0.0, number: int = 3, density: float = 1000.0) -> NewObject:
    mesh = profile()
    mesh.apply_translation([0, 0, shift])
    mesh.export(path)
    return make_object(path, "kit", number, Told(density=density))


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.slow
def test_what_is_written_is_the_object_and_again_nothing_changes(tmp_path: Path) -> None:
    out = tmp_path / "kit"
    new = part(tmp_path / "part.stl")
    assert write_objects([new], out, bop_models=False) == ["added"]
    assert Models(out / "models").mesh(3).vertices.shape == (12, 3)
    catalogue = read_catalogue(out / "objects.toml")
    loaded = load_object("kit-3", catalogue=catalogue)
    assert loaded.mass_kg == new.entry.mass_kg
    np.testing.assert_array_equal(loaded.vertices, new.mesh.vertices)
    np.testing.assert_array_equal(loaded.sim_T_ref, new.grasp_object.sim_T_ref)
    again = load_object("kit-3", catalogue=catalogue, bop_dirs={"kit": out})
    np.testing.assert_array_equal(again.inertia, loaded.inertia)
    before = content(out)
    again = part(tmp_path / "part.stl")
    assert write_objects([again], out, bop_models=False) == ["unchanged"]
    assert content(out) == before


@pytest.mark.slow
def test_others_stay_and_another_object_of_the_number_is_refused(tmp_path: Path) -> None:
    out = tmp_path / "kit"
    write_objects([part(tmp_path / "part.stl")], out, bop_models=False)
    assert write_objects([part(tmp_path / "b.stl", number=4)], out, bop_models=False) == ["added"]
    assert list(json.loads((out / "models/models_info.json").read_text())) == ["3", "4"]
    before = content(out)
    for other, said in (
        (part(tmp_path / "part.stl", shift=0.02), r"the same shape, moved by \(0, 0, 20\) mm"),
        (part(tmp_path / "part.stl", density=900.0), r"mass_kg = 0.03072 \(now 0.02765\)"),
    ):
        with pytest.raises(MismatchError, match=said):
            write_objects([other], out, bop_models=False)
        assert content(out) == before
    moved = part(tmp_path / "part.stl", shift=0.02)
    assert write_objects([moved], out, bop_models=False, replace=True) == ["replaced"]
    assert Models(out / "models")[3].lower[2] == pytest.approx(0.02)
    assert content(out)["models/obj_000004.ply"] == before["models/obj_000004.ply"]


@pytest.mark.slow
def test_a_catalogue_and_a_bop_model_that_differ(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    write_objects([part(tmp_path / "part.stl")], first, bop_models=False)
    write_objects([part(tmp_path / "part.stl", shift=0.02)], second, bop_models=False)
    catalogue = read_catalogue(first / "objects.toml")
    with pytest.raises(MismatchError, match=r"moved by \(0, 0, -20\) mm"):
        load_object("kit-3", catalogue=catalogue, bop_dirs={"kit": second})


@pytest.mark.slow
def test_bop_models_stay_where_they_are(tmp_path: Path) -> None:
    root = tmp_path / "kit"
    write_objects([part(tmp_path / "part.stl")], root, bop_models=False)
    (root / "objects.toml").unlink()
    before = content(root)
    (source,) = find_sources(root, None)
    assert source.obj_id == 3 and source.info is not None
    new = make_object(source.path, "kit", 3, Told(mass_kg=0.1), info=source.info)
    assert write_objects([new], tmp_path / "own", bop_models=True) == ["added"]
    assert content(root) == before and set(content(tmp_path / "own")) == {
        ".lock",
        "objects.toml",
    }
    catalogue = read_catalogue(tmp_path / "own" / "objects.toml")
    assert load_object("kit-3", catalogue=catalogue, bop_dirs={"kit": root}).mass_kg == 0.1
    with pytest.raises(InputError, match="give the BOP directory of kit"):
        load_object("kit-3", catalogue=catalogue)


def test_sources(tmp_path: Path) -> None:
    box = trimesh.creation.box((40.0, 60, 100))
    for name in ("b.stl", "a.ply"):
        box.export(tmp_path / name)
    (tmp_path / "notes.txt").write_text("")
    assert [(s.path.name, s.obj_id) for s in find_sources(tmp_path, None)] == [
        ("a.ply", 1),
        ("b.stl", 2),
    ]
    assert [s.obj_id for s in find_sources(tmp_path, 7)] == [7, 8]
    named = tmp_path / "named"
    named.mkdir()
    box.export(named / "obj_000012.stl")
    assert [s.obj_id for s in find_sources(named, None)] == [12]
    for path, number, said in (
        (tmp_path / "c.stl", 1, "no such mesh"),
        (tmp_path / "b.stl", None, "needs a number"),
        (tmp_path / "b.stl", -1, "0 to 999999"),
    ):
        with pytest.raises(InputError, match=said):
            find_sources(path, number)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"has no mesh .* and no models_info.json"):
        find_sources(tmp_path / "empty", None)


def test_built_in_objects() -> None:
    assert built_in_ids("ycbv") == [2, 3, 4, 5, 8, 9, 12] and built_in_ids("kit") == []


def numbered(new: NewObject, number: int) -> NewObject:
    return replace(new, entry=replace(new.entry, name=f"kit-{number}", obj_id=number))


def add_one_by_one(path: Path, out: Path, numbers: list[int], start: float) -> None:
    """What each of two processes does."""
    new = part(path)
    time.sleep(max(0.0, start - time.time()))
    for number in numbers:
        write_objects([numbered(new, number)], out, bop_models=False)


@pytest.mark.slow
def test_two_processes_on_one_directory_lose_nothing(tmp_path: Path) -> None:
    code = (
        "import sys, pathlib, test_adding as t; "
        "a = sys.argv; t.add_one_by_one(pathlib.Path(a[1]), pathlib.Path(a[2]), "
        "[int(x) for x in a[4:]], float(a[3]))"
    )
    here = Path(__file__)
    paths = [here.parent, here.parents[2], here.parents[3] / "src"]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths))}
    start, running = time.time() + 5, []
    for first in (1, 2):
        numbers = [str(n) for n in range(first, 21, 2)]
        words = [tmp_path / f"{first}.stl", tmp_path / "kit", start, *numbers]
        running.append(subprocess.Popen([sys.executable, "-c", code, *map(str, words)], env=env))
    assert [one.wait(timeout=120) for one in running] == [0, 0]
    assert sorted(Models(tmp_path / "kit" / "models").info) == list(range(1, 21))
    listed = read_catalogue(tmp_path / "kit" / "objects.toml")
    assert all(f"kit-{n}" in listed for n in range(1, 21))


def test_who_waits_too_long_is_told_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adding, "_WAIT_S", 0.2)
    new = part(tmp_path / "part.stl")
    with (
        exclusive_lock(tmp_path / "kit" / ".lock", "no"),
        pytest.raises(InputError, match="another process is adding objects here"),
    ):
        write_objects([new], tmp_path / "kit", bop_models=False)
    assert not (tmp_path / "kit" / "objects.toml").exists()


def test_folders_that_do_not_say_which_objects_are_refused(tmp_path: Path) -> None:
    parts = tmp_path / "parts"
    parts.mkdir()
    for name in ("obj_000003.stl", "obj_000003.ply"):
        profile().export(parts / name)
    with pytest.raises(InputError, match="two meshes have the same number; keep one of each"):
        find_sources(parts, None)
    models = write_models(tmp_path / "models", obj_1={}, obj_2={})
    assert [s.obj_id for s in find_sources(tmp_path, None)] == [1, 2]
    with pytest.raises(InputError, match="has no object 7") as caught:
        find_sources(models, 7)
    assert caught.value.parameters == ("id",)
    (models / "obj_000002.ply").unlink()
    with pytest.raises(InputError, match=r"lists 2 objects, but there is no obj_000002\.ply"):
        find_sources(models, None)


def test_a_damaged_model_is_replaced_only_where_that_is_asked_for(tmp_path: Path) -> None:
    out, new = tmp_path / "kit", part(tmp_path / "part.stl")
    write_objects([new], out, bop_models=False)
    model = out / "models" / "obj_000003.ply"
    model.write_text("no mesh")
    with pytest.raises(GraspcastError, match=r"obj_000003\.ply"):
        write_objects([new], out, bop_models=False)
    assert model.read_text() == "no mesh"
    write_objects([new], out, bop_models=False, replace=True)
    assert Models(out / "models").mesh(3).vertices.shape == (12, 3)
