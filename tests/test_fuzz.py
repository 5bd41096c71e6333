"""Inputs that once made a reader fail with another exception than a GraspcastError."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest

from graspcast.errors import GraspcastError

CORPUS = Path(__file__).parent / "data" / "fuzz"
FILES = sorted(path for path in CORPUS.glob("*/*") if path.is_file())


@pytest.fixture(scope="module")
def readers() -> ModuleType:
    sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
    import fuzz_readers

    return fuzz_readers


@pytest.fixture(scope="module")
def seeds(readers: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("seeds")
    readers.make_seeds(folder)
    return folder


@pytest.mark.ill_typed
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_an_input_that_failed_once_is_read_or_refused(
    readers: ModuleType, seeds: Path, path: Path
) -> None:
    reader = readers.BY_NAME[path.parent.name]
    place = reader.path(seeds)
    valid = place.read_bytes()
    shutil.copy(path, place)
    try:
        reader.read(place)
    except GraspcastError:
        pass
    finally:
        place.write_bytes(valid)
