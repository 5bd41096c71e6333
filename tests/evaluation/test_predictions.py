"""Forecasts: checked when they are made, kept as files, refused when broken."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from graspcast.errors import FormatError, InputError, MismatchError
from graspcast.evaluation.predictions import Forecasts

GOOD = Forecasts(
    "unseen_scenes",
    "m",
    "epos",
    "parallel",
    np.array([0.0, 0.5, 1.0]),
    np.array([True, False, True]),
    np.array(["d-1", "d-1", "d-2"]),
    np.array(["d/1", "d/2", "d/2"]),
)


@pytest.mark.ill_typed
def test_columns_of_different_lengths_are_refused() -> None:
    with pytest.raises(MismatchError, match=r"m \(unseen_scenes, epos, parallel\)"):
        dataclasses.replace(GOOD, success=np.array([True]))


@pytest.mark.parametrize("wrong", [-0.01, 1.01, np.nan, np.inf])
def test_what_is_no_probability_is_refused(wrong: float) -> None:
    with pytest.raises(InputError, match="1 of 3 predictions are no probabilities"):
        dataclasses.replace(GOOD, probability=np.array([0.5, wrong, 0.5]))


def test_none_at_all_is_refused() -> None:
    nothing = {
        name: getattr(GOOD, name)[:0] for name in ("probability", "success", "objects", "scenes")
    }
    with pytest.raises(InputError, match="there are no predictions"):
        dataclasses.replace(GOOD, **nothing)


def test_some_rows_are_selected_in_their_order() -> None:
    some = GOOD.select(np.array([2, 0]))
    assert_array_equal(some.probability, [1.0, 0.0])
    assert_array_equal(some.success, [True, True])
    assert_array_equal(some.objects, ["d-2", "d-1"])
    assert_array_equal(some.scenes, ["d/2", "d/1"])
    assert (some.method, some.principal) == (GOOD.method, GOOD.principal)
    with pytest.raises(InputError, match="there are no predictions"):
        GOOD.select(np.array([], dtype=np.int64))


def test_kept_and_read_back(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b.npz"
    GOOD.save(path, "settings 1")
    again = Forecasts.load(path, "settings 1")
    assert again is not None
    for field in dataclasses.fields(GOOD):
        assert_array_equal(getattr(again, field.name), getattr(GOOD, field.name))
    assert len(again) == 3
    assert Forecasts.load(path, "settings 2") is None
    assert Forecasts.load(tmp_path / "c.npz", "settings 1") is None
    assert [p.name for p in path.parent.iterdir()] == ["b.npz"]


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "f.npz"
    GOOD.save(path, "x")
    content = path.read_bytes()
    for size in range(0, len(content), 97):
        path.write_bytes(content[:size])
        with pytest.raises(FormatError, match="delete it and start again"):
            Forecasts.load(path, "x")
