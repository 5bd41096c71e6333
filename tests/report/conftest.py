"""Small runs, read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from browser import Browser, started
from graspcast.report.run_data import RunData, read_run
from graspcast.report.run_files import find_run
from small_run import NASTY, write_run


@pytest.fixture(scope="session")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("runs") / "small")


@pytest.fixture(scope="session")
def nasty_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("runs") / "nasty", looks=1, grasp=NASTY)


@pytest.fixture(scope="session")
def run(run_dir: Path) -> RunData:
    return read_run(find_run(run_dir))


@pytest.fixture(scope="session")
def nasty(nasty_dir: Path) -> RunData:
    return read_run(find_run(nasty_dir))


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with started() as found:
        yield found
