"""Covariances of poses: what is refused, and spreads seen from any side."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from graspcast.errors import InputError
from graspcast.pose.covariances import check_covariance, check_deviations, covariance_from_any_side

GOOD = np.diag([1e-6, 4e-6, 1e-4, 1e-3, 1e-3, 1e-3])


def changed(i: int, j: int, value: float) -> np.ndarray:
    matrix = GOOD.copy()
    matrix[i, j] = matrix[j, i] = value
    return matrix


def test_a_covariance_in_metres_and_radians_is_accepted() -> None:
    check_covariance(GOOD)
    check_covariance(changed(0, 5, 1e-5))


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (np.diag([1.0, 1.0, 100.0, 1e-3, 1e-3, 1e-3]), "mm²"),
        (np.diag([1e-6, 1e-6, 1e-6, 16.0, 16.0, 16.0]), "degrees²"),
        (changed(0, 0, 0.0), "not above zero"),
        (changed(0, 0, -1e-6), "not above zero"),
        (changed(0, 2, 2e-5), "not positive definite"),
        (changed(1, 1, np.nan), "finite"),
        (GOOD + np.eye(6, k=1) * 1e-5, "not symmetric"),
    ],
)
def test_what_is_no_covariance_of_a_pose_is_refused(matrix: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        check_covariance(matrix)


@pytest.mark.ill_typed
def test_another_shape_is_refused() -> None:
    with pytest.raises(InputError, match="6x6"):
        check_covariance(np.eye(3))


def test_seen_from_any_side_each_axis_has_the_mean_variance() -> None:
    found = covariance_from_any_side(0.002, 0.008, 0.07)
    rng = np.random.default_rng(0)
    rays = rng.standard_normal((20_000, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    shift = 0.002 * rng.standard_normal(rays.shape)
    shift += rays * (0.008 * rng.standard_normal(len(rays)) - (shift * rays).sum(axis=1))[:, None]
    assert_allclose(np.cov(shift.T), found[:3, :3], atol=1.5e-6)
    assert_allclose(found[3:, 3:], 0.07**2 * np.eye(3))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((0.0, 0.01, 0.1), "across the viewing ray is 0 m"),
        ((0.01, 10.0, 0.1), "along the viewing ray is 10 m"),
        ((0.01, 0.01, 4.0), "of the rotation is 4 rad"),
        ((float("nan"), 0.01, 0.1), "across"),
    ],
)
def test_deviations_out_of_range_are_refused(given: tuple[float, float, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        check_deviations(*given)


@pytest.mark.parametrize("axis", range(6))
def test_every_axis_counts(axis: int) -> None:
    """A standard deviation of up to half a metre or half a turn is possible, more is not."""
    most = 0.5 if axis < 3 else np.pi
    check_covariance(changed(axis, axis, (0.999 * most) ** 2))
    with pytest.raises(InputError, match="position" if axis < 3 else "rotation"):
        check_covariance(changed(axis, axis, (1.001 * most) ** 2))


@pytest.mark.parametrize("correlation", [1.0, -1.0, 1 - 1e-12])
def test_what_is_singular_is_refused(correlation: float) -> None:
    """Axes that know each other's error exactly."""
    value = correlation * np.sqrt(GOOD[0, 0] * GOOD[5, 5])
    with pytest.raises(InputError, match="not positive definite"):
        check_covariance(changed(0, 5, value))
    check_covariance(changed(0, 5, (1 - 1e-6) * value))


def test_the_units_that_would_fit_are_named_with_their_numbers() -> None:
    with pytest.raises(InputError, match=r"of 2 m; .*: 0\.002 m"):
        check_covariance(changed(2, 2, 4.0))
    with pytest.raises(InputError, match=r"of 4 rad, .*it is 0\.0698 rad"):
        check_covariance(changed(3, 3, 16.0))


@pytest.mark.parametrize("place", range(3))
def test_each_deviation_is_above_zero_and_one_of_an_estimate(place: int) -> None:
    most = (0.5, 0.5, np.pi)[place]
    for value, fits in ((most, True), (1.01 * most, False), (0.0, False), (-0.1, False)):
        given = [0.002, 0.008, 0.07]
        given[place] = value
        if fits:
            check_deviations(*given)
        else:
            with pytest.raises(InputError, match="above zero and at most"):
                check_deviations(*given)


@pytest.mark.parametrize("factor", [0.5, 1.5, 1.00001])
def test_both_halves_have_to_be_alike(factor: float) -> None:
    matrix = changed(0, 5, 1e-5)
    check_covariance(matrix)
    matrix[5, 0] *= factor
    with pytest.raises(InputError, match="not symmetric"):
        check_covariance(matrix)
