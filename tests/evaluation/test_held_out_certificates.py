"""Certificates tried on held-out units."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from graspcast.evaluation.held_out_certificates import (
    best_guides,
    certify_views,
    resample_certificates,
)

RNG = np.random.default_rng(0)


def test_sure_and_right_forecasts_are_attempted() -> None:
    success = RNG.random(600) < 0.6
    probability = np.where(success, 0.97, 0.2)
    found = resample_certificates(probability, success, np.arange(600), resamplings=10)
    assert found["none"] == found["false"] == 0
    assert found["attempted"] == pytest.approx(0.6, abs=0.03)
    assert found["success"] == 1
    assert 0.85 < found["of_perfect"] < 0.95


def test_forecasts_that_do_not_rank_are_not_certified() -> None:
    success = RNG.random(600) < 0.6
    found = resample_certificates(RNG.random(600), success, np.arange(600), resamplings=10)
    assert found["none"] == 1 and found["attempted"] == 0
    assert np.isnan(found["success"])


def table(n: int = 300) -> pl.DataFrame:
    rows = []
    for i in range(n):
        for name, good in (("a", i % 2 == 0), ("b", i % 2 == 1)):
            common = {"row": "3 views", "alone": "", "gripper": "p", "instance": i}
            forecast = {"probability": 0.95 if good else 0.1, "one_view": 0.5}
            rows.append(
                {**common, **forecast, "principal": name, "success": good, "image": f"d/1/{i}"}
            )
    return pl.DataFrame(rows)


def test_the_best_guide_is_chosen_for_each_instance() -> None:
    found = best_guides(table(4), "probability")
    assert found["principal"].to_list() == ["a", "b", "a", "b"]


def test_the_best_guide_is_attempted_more_often() -> None:
    entries = {(e["guide"], e["views"]): e for e in certify_views(table(), resamplings=5)}
    assert entries["best", 3]["attempted"] == 1
    assert entries["a", 3]["attempted"] == pytest.approx(0.5, abs=0.1)
    assert entries["best", 1]["attempted"] == 0
