"""Tails of errors, and whether estimators fail together."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from scipy.stats import spearmanr

from graspcast.errors import MismatchError
from graspcast.estimates.error_statistics import correlations, tails


def table(seed: int, n: int = 200, start: int = 0) -> pl.DataFrame:
    rng = np.random.default_rng(seed)
    return pl.DataFrame(
        {
            "scene_id": np.ones(n, dtype=np.int64),
            "im_id": np.arange(start, start + n),
            "obj_id": np.arange(start, start + n) % 3,
            "gt_id": np.zeros(n, dtype=np.int64),
            "rotation_deg": rng.gamma(1.0, 20.0, n),
            "translation_mm": rng.gamma(2.0, 15.0, n),
            "ray_share": rng.random(n),
        }
    )


def test_tails_are_numpy_s_quantiles_of_each_object_and_of_all() -> None:
    errors = table(0)
    found = tails(errors)
    assert found["obj_id"].to_list() == [0, 1, 2, None]
    for row in found.rows(named=True):
        here = errors if row["obj_id"] is None else errors.filter(pl.col("obj_id") == row["obj_id"])
        rotation, shift = here["rotation_deg"].to_numpy(), here["translation_mm"].to_numpy()
        assert row["n"] == len(here)
        for q in (50, 75, 95):
            assert row[f"rotation_deg_{q}"] == pytest.approx(np.percentile(rotation, q))
            assert row[f"translation_mm_{q}"] == pytest.approx(np.percentile(shift, q))
        assert row["over_30_deg"] == pytest.approx((rotation > 30).mean())
        assert row["over_90_deg"] == pytest.approx((rotation > 90).mean())
        assert row["over_50_mm"] == pytest.approx((shift > 50).mean())
        assert row["ray_share_50"] == pytest.approx(np.median(here["ray_share"].to_numpy()))


def test_correlations_are_scipy_s_over_the_instances_in_common() -> None:
    errors = {"a": table(0), "b": table(1, start=50), "c": table(0)}
    found = correlations(errors)
    pairs = {(row["first"], row["second"]): row for row in found.rows(named=True)}
    assert set(pairs) == {("a", "b"), ("a", "c"), ("b", "c")}
    same = pairs["a", "c"]
    assert same["rotation"] == pytest.approx(1.0) and same["both_large"] == 1.0
    keys = ["im_id", "obj_id"]
    both = errors["a"].join(errors["b"], on=keys, suffix="_b")
    assert pairs["a", "b"]["n"] == len(both) > 0
    for name, column in (("rotation", "rotation_deg"), ("translation", "translation_mm")):
        expected = spearmanr(both[column], both[f"{column}_b"]).statistic
        assert pairs["a", "b"][name] == pytest.approx(expected)


def test_none_in_common_and_one_alone() -> None:
    with pytest.raises(MismatchError, match="a and b have no instance in common"):
        correlations({"a": table(0), "b": table(1, start=1000)})
    assert len(correlations({"a": table(0)})) == 0
