"""Ranking of grasps, and what a robot can reach."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.instances import InstanceKey
from graspcast.forecasting.grasp_ranking import (
    Candidates,
    Reachable,
    nothing_reachable,
    refuse_mask,
)
from graspcast.forecasting.model_card import ModelCard

CARD = ModelCard(
    principal="a",
    supporters=("b",),
    gripper="parallel",
    objects=("d-1", "d-2"),
    method="blend",
    features="full",
    settings={},
    samples=100,
    success_rate=0.5,
    data="",
    versions={},
    grasps={"d-1": {"top": 50, "side": 40, "rim": 4}, "d-2": {"reference": 60}},
)
KEYS = [InstanceKey("d", 1, 1, n, 0) for n in (1, 2, 1)]
NUMBERS = np.array([0, 1, 0])
PLAIN = np.array([1.0, 0.0])


def candidates(reachable: Reachable | None = None) -> Candidates:
    return Candidates.of(CARD, lambda: KEYS, NUMBERS, reachable)


def names(found: Sequence[Sequence[object]]) -> list[list[str]]:
    return [[each.grasp for each in some] for some in found]  # type: ignore[attr-defined]


def test_every_grasp_of_the_object_is_a_candidate() -> None:
    given = candidates()
    assert_array_equal(given.row, [0, 0, 0, 1, 2, 2, 2])
    assert_array_equal(given.target, [0, 1, 2, 3, 0, 1, 2])  # rim, side, top; reference


def test_the_best_comes_first_but_never_one_that_rests_on_few_outcomes() -> None:
    found = candidates().ranking(np.array([0.99, 0.4, 0.7, 0.5, 0.2, 0.6, 0.3]), PLAIN)
    assert names(found.grasps) == [["top", "side", "rim"], ["reference"], ["side", "top", "rim"]]
    assert_array_equal(found.targets, [2, 3, 1])
    np.testing.assert_allclose(found.probability, [0.7, 0.5, 0.6])
    rim = found.grasps[0][-1]
    assert (rim.probability, rim.outcomes, rim.rests_on_few) == (0.99, 4, True)


def test_a_correction_is_of_grasps_among_which_is_chosen_and_keeps_their_order() -> None:
    p = np.array([0.1, 0.8, 0.7, 0.5, 0.2, 0.6, 0.3])
    plain, corrected = (
        candidates().ranking(p, np.array([s, t])) for s, t in ((1.0, 0.0), (0.5, -0.3))
    )
    assert names(plain.grasps) == names(corrected.grasps)
    assert corrected.probability[0] < plain.probability[0]
    assert corrected.probability[1] == plain.probability[1] == 0.5


@pytest.mark.parametrize(
    ("reachable", "expected"),
    [
        (["side", "reference"], [["side"], ["reference"], ["side"]]),
        ([], [[], [], []]),
        ({KEYS[0]: {"top"}}, [["top"], [], ["top"]]),
        (lambda key: ("rim",) if key.obj_id == 1 else (), [["rim"], [], ["rim"]]),
    ],
)
def test_what_is_reachable_is_a_collection_a_mapping_or_a_function(
    reachable: Reachable, expected: list[list[str]]
) -> None:
    given = candidates(reachable)
    found = given.ranking(np.full(len(given.row), 0.5), PLAIN)
    assert names(found.grasps) == expected
    assert_array_equal(np.isnan(found.probability), [not some for some in expected])


def test_an_unknown_grasp_is_refused_and_the_known_ones_are_listed() -> None:
    with pytest.raises(UnknownNameError, match="known: reference, rim, side, top"):
        candidates(["tip"])
    with pytest.raises(UnknownNameError, match="grasp of d-2 'top'; known: reference"):
        candidates({KEYS[1]: ["top"]})


@pytest.mark.ill_typed
@pytest.mark.parametrize("given", ["top", 3])
def test_what_is_no_collection_of_names_is_refused(given: object) -> None:
    with pytest.raises(InputError, match="a collection of names"):
        candidates(given)  # type: ignore[arg-type]


def test_a_forecast_that_is_missing_is_no_candidate() -> None:
    found = candidates().ranking(np.array([np.nan, 0.4, 0.7, np.nan, 0.2, 0.6, 0.3]), PLAIN)
    assert names(found.grasps) == [["top", "side"], [], ["side", "top", "rim"]]


def test_an_object_that_is_not_in_training_has_one_candidate() -> None:
    given = Candidates.of(CARD, lambda: KEYS, np.array([-1, 1, -1]))
    assert_array_equal(given.target, [-1, 3, -1])


def test_a_card_without_grasps_knows_the_reference_grasp() -> None:
    plain = dataclasses.replace(CARD, grasps={})
    given = Candidates.of(plain, lambda: KEYS, NUMBERS)
    assert_array_equal(given.target, NUMBERS)
    assert names(given.ranking(np.array([0.1, 0.2, 0.3]), PLAIN).grasps) == [["reference"]] * 3


@pytest.mark.ill_typed
def test_a_mapping_of_what_is_reachable_has_keys_of_instances() -> None:
    with pytest.raises(InputError, match=r"has keys of instances, .*, not 'd-1'"):
        candidates({"d-1": {"rim"}})  # type: ignore[dict-item]


def test_a_certificate_does_not_go_with_what_is_reachable() -> None:
    refuse_mask(None)
    with pytest.raises(MismatchError, match="choosing among all grasps"):
        refuse_mask([])


def test_the_reason_lists_what_is_known() -> None:
    assert nothing_reachable(CARD, "d-1").endswith("of d-1: rim, side, top")
