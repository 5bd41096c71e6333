"""Versions of the software."""

from __future__ import annotations

import platform

import numpy as np
import polars as pl

import graspcast
from graspcast.io.provenance import versions


def test_versions_are_those_that_run() -> None:
    assert versions("polars") == {
        "graspcast": graspcast.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "polars": pl.__version__,
    }
