"""Small datasets for the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from forest_commands import write_trained
from network_commands import write_made


@pytest.fixture
def world(tmp_path: Path) -> Path:
    """A dataset of one object, estimates and outcomes, for ``network_commands``."""
    return write_made(tmp_path)


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of two objects and three trained models, for ``forest_commands``."""
    root = tmp_path_factory.mktemp("trained")
    write_trained(root)
    return root
