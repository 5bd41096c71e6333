"""Tables of covariances, as ``fuse`` writes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_allclose

from graspcast.errors import FormatError, MismatchError, UnknownNameError
from graspcast.estimates.instances import InstanceKey
from graspcast.io.tables import write_table
from graspcast.views.covariance_table import read_covariances


def frame(*variances: float) -> pl.DataFrame:
    """One row an instance of mine-3, but the last, which is of mine-4."""
    n = len(variances)
    columns: dict[str, list[float] | list[int] | list[str]] = {
        "dataset": ["mine"] * n,
        "scene_id": [1] * n,
        "im_id": list(range(n)),
        "obj_id": [3] * (n - 1) + [4],
        "est_id": [0] * n,
    }
    for i, j in zip(*np.triu_indices(6), strict=True):
        columns[f"cov_obj_{i}{j}"] = [v if i == j else 0.0 for v in variances]
    return pl.DataFrame(columns)


@pytest.mark.parametrize("name", ["covariances.csv", "covariances.parquet"])
def test_the_mean_of_an_objects_covariances(tmp_path: Path, name: str) -> None:
    write_table(tmp_path / name, frame(1e-6, 3e-6, 9e-6))
    table = read_covariances(tmp_path / name)
    assert len(table) == 3
    assert_allclose(table.of("mine-3").mean(), 2e-6 * np.eye(6))
    with pytest.raises(UnknownNameError, match="known: mine-3, mine-4"):
        table.of("mine-5")


def test_the_covariance_of_an_instance(tmp_path: Path) -> None:
    path = tmp_path / "covariances.csv"
    write_table(path, frame(1e-6, 3e-6, 9e-6))
    table = read_covariances(path)
    assert_allclose(table.at(InstanceKey("mine", 1, 2, 4, 0)), 9e-6 * np.eye(6))
    of = table.of("mine-4")
    assert_allclose(of.at(InstanceKey("mine", 1, 2, 4, 0)), 9e-6 * np.eye(6))
    with pytest.raises(MismatchError, match="no covariance of mine-4 in image 1/2, est_id 1"):
        table.at(InstanceKey("mine", 1, 2, 4, 1))
    write_table(path, frame(1e-6, 3e-6).with_columns(im_id=pl.lit("first")))
    with pytest.raises(FormatError, match="no whole number"):
        read_covariances(path)
    # A table for other uses need not name instances.
    write_table(path, frame(1e-6, 3e-6).drop("im_id"))
    assert read_covariances(path).keys == ()


def test_what_is_no_table_of_covariances_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "covariances.csv"
    write_table(path, frame(1e-6, 1e-6).drop("cov_obj_25"))
    with pytest.raises(FormatError, match="no column cov_obj_25"):
        read_covariances(path)
    write_table(path, frame(1e-6, 1e-6).clear())
    with pytest.raises(FormatError, match="no row"):
        read_covariances(path)
    write_table(path, frame(1e-6, 4.0))
    with pytest.raises(FormatError, match=r"row 2: .*mm²"):
        read_covariances(path)
