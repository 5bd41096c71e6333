from __future__ import annotations

import numpy as np
import pytest

from graspcast.pose.transforms import rotation_angle, rotation_from_vector
from graspcast.simulation.objects.rotation_groups import closed_group

X, Y, Z = np.eye(3)
DIAGONAL = np.ones(3) / np.sqrt(3)


def turn(axis: np.ndarray, fold: int) -> np.ndarray:
    return rotation_from_vector(axis * 2 * np.pi / fold)


@pytest.mark.parametrize(
    ("generators", "order"),
    [
        ([], 1),
        ([turn(Z, 7)], 7),
        ([turn(X, 2), turn(Y, 2)], 4),
        ([turn(Z, 6), turn(X, 2)], 12),
        ([turn(DIAGONAL, 3), turn(Z, 2)], 12),
        ([turn(DIAGONAL, 3), turn(Z, 4)], 24),
    ],
)
def test_orders_of_the_groups_of_solids(generators: list[np.ndarray], order: int) -> None:
    group = closed_group(generators, 0.1)
    assert group is not None and len(group) == order
    np.testing.assert_array_equal(group[0], np.eye(3))


def test_generators_that_are_a_little_off_give_an_exact_group() -> None:
    off = rotation_from_vector(np.array([0.01, -0.008, 0.012]))
    group = closed_group([off @ turn(Z, 4), turn(X, 4) @ off], 0.2)
    assert group is not None and len(group) == 24
    for first in group:
        for second in group:
            angles = rotation_angle(np.swapaxes(group, -1, -2) @ (first @ second))
            assert angles.min() < 1e-5


def test_rotations_without_a_finite_group() -> None:
    assert closed_group([rotation_from_vector(np.array([0.0, 0.0, 1.0]))], 0.01) is None
