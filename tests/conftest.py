"""Where tests find the published data, and what happens where there is none."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import jaxtyping
import pytest
from hypothesis import settings

from graspcast.paper.dataset import Published

# Imports and shared machines take their time; no test is about how long it takes.
settings.register_profile("graspcast", deadline=None)
settings.load_profile("graspcast")


def pytest_configure(config: pytest.Config) -> None:
    """Let forecasters be trained on few data; pyproject.toml cannot name the category.

    To resolve it imports graspcast, before run-time types could be added.
    """
    config.addinivalue_line("filterwarnings", "ignore::graspcast.errors.TrainingDataWarning")


@pytest.fixture(autouse=True)
def _run_time_types(request: pytest.FixtureRequest) -> Iterator[None]:
    """Under ``--jaxtyping-packages`` annotations hold, but where a test breaks them on purpose."""
    on_purpose = request.node.get_closest_marker("ill_typed") is not None
    jaxtyping.config.update("jaxtyping_disable", on_purpose)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The published data; a test that asks for it is skipped where it is absent."""
    beside = Path(__file__).parents[2] / "shared" / "data"
    directory = Path(os.environ.get("GRASPCAST_DATA") or beside)
    if not (directory / "published").is_dir():
        pytest.skip(
            f"the published data is not at {directory}: set GRASPCAST_DATA to a directory "
            "that holds published/, raw/ and bop/"
        )
    return directory


@pytest.fixture(scope="session")
def published(data_dir: Path) -> Path:
    return data_dir / "published"


@pytest.fixture(scope="session")
def data(data_dir: Path) -> Published:
    """The published data, read once a session."""
    return Published(data_dir)
