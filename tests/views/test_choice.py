"""Choice of views by parallax."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy import ndarray

from graspcast.views.choice import choose_views, viewing_directions


def at(*degrees: float) -> ndarray:
    angle = np.deg2rad(np.array(degrees))
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1)


def test_views_are_spread() -> None:
    chosen = choose_views(at(0)[0], at(10, 20, 30, 40, 50, 60), 2, np.deg2rad(12))
    assert chosen.tolist() == [5, 2]


def test_no_view_is_nearer_than_the_least_parallax_to_any_other() -> None:
    degrees = (5, 11, 14, 18, 25)
    chosen = choose_views(at(0)[0], at(*degrees), 5, np.deg2rad(12))
    assert [degrees[i] for i in chosen] == [25]
    assert len(choose_views(at(0)[0], at(*degrees), 5, np.deg2rad(30))) == 0


def test_the_same_place_is_no_other_view() -> None:
    assert len(choose_views(at(0)[0], at(0, 0, 0), 2, 0.0)) == 0
    assert len(choose_views(at(0)[0], np.zeros((0, 3)), 2)) == 0


def test_directions_are_from_the_object() -> None:
    found = viewing_directions(np.array([0.0, 0.0, 1.0]), np.array([[0.0, 0.0, 3.0], [2, 0, 1]]))
    np.testing.assert_allclose(found, [[0, 0, 1], [1, 0, 0]])


@given(st.lists(st.floats(-170, 170), max_size=12), st.integers(0, 5), st.floats(1, 60))
def test_choices_keep_the_rules(degrees: list[float], most: int, least: float) -> None:
    chosen = choose_views(at(0)[0], at(*degrees), most, np.deg2rad(least))
    assert len(chosen) <= most
    angles = [0.0, *(degrees[i] for i in chosen)]
    for i, one in enumerate(angles):
        for other in angles[:i]:
            apart = abs(one - other) % 360
            assert min(apart, 360 - apart) >= least - 1e-6
    assert len(set(chosen.tolist())) == len(chosen)


@pytest.mark.parametrize("shift", [0, 3])
def test_ties_go_to_the_first(shift: int) -> None:
    others = np.roll(at(40, 40, 5, 5), shift, axis=0)
    chosen = choose_views(at(0)[0], others, 1, np.deg2rad(12))
    assert chosen.tolist() == [int(np.flatnonzero(others[:, 0] == at(40)[0, 0])[0])]
