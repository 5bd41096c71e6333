"""The objects to train for, and the name of their dataset."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from graspcast.errors import InputError, UnknownNameError
from graspcast.training.objects import Objects
from solid_models import write_solid_models


@pytest.fixture(scope="module")
def solids(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_solid_models(tmp_path_factory.mktemp("data") / "toy" / "models")


def test_the_dataset_is_the_directory_that_holds_models(solids: Path) -> None:
    assert Objects.read(solids).dataset == Objects.read(solids.parent).dataset == "toy"
    assert Objects.read(solids).ids == (1, 4, 7)
    assert Objects.read(solids, [7, 1], "mine").ids == (1, 7)
    assert Objects.read(solids, dataset="mine").dataset == "mine"
    with pytest.raises(UnknownNameError, match="known: 1, 4, 7"):
        Objects.read(solids, [2])


def test_a_directory_called_otherwise_needs_the_name(solids: Path, tmp_path: Path) -> None:
    shutil.copytree(solids, tmp_path / "parts")
    with pytest.raises(InputError, match="this one is called parts; give the name") as error:
        Objects.read(tmp_path / "parts")
    assert error.value.parameters == ("dataset",)
    assert Objects.read(tmp_path / "parts", dataset="toy").dataset == "toy"


def test_the_digest_tells_other_meshes_and_other_objects(solids: Path, tmp_path: Path) -> None:
    mine = Objects.read(solids).digest
    assert Objects.read(solids).digest == mine
    assert Objects.read(solids, [1, 4]).digest != mine
    copy = shutil.copytree(solids, tmp_path / "models")
    assert Objects.read(copy).digest == mine
    path = copy / "obj_000001.ply"
    content = bytearray(path.read_bytes())
    # The first vertex's red.
    content[content.index(b"end_header") + len(b"end_header\n") + 12] ^= 1
    path.write_bytes(content)
    assert Objects.read(copy).digest != mine
