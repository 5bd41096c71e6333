"""Pose errors: of estimates, or drawn from standard deviations and covariances."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from graspcast.errors import InputError, MismatchError
from graspcast.pose.transforms import rotation_angle
from graspcast.simulation.campaign.pose_errors import PoseErrors
from graspcast.simulation.campaign.transferred_errors import trials_from_transferred_errors
from graspcast.simulation.objects.types import Grasp
from graspcast.views.covariance_table import CovarianceTable
from poses import random_poses, results_of

GRASP = Grasp(np.eye(4), "mine-3", "parallel")


@pytest.mark.parametrize("tails", [3.0, 4.0, math.inf])
def test_drawn_errors_have_the_given_deviations_whatever_their_tails(tails: float) -> None:
    errors = PoseErrors.of_deviations(0.002, 0.008, 0.07, tails=tails)
    found = errors.truth.std(axis=0)
    assert_allclose(found, [0.002, 0.002, 0.008, 0.07, 0.07, 0.07], rtol=0.15)


def test_fewer_degrees_of_freedom_are_more_gross_errors() -> None:
    def gross(tails: float) -> float:
        along = PoseErrors.of_deviations(0.002, 0.008, 0.07, tails=tails).truth[:, 2]
        return float(np.mean(np.abs(along) > 4 * 0.008))

    assert gross(3.0) > gross(8.0) > 3 * gross(math.inf)


def test_drawn_errors_guide_trials_of_their_size_from_every_side() -> None:
    errors = PoseErrors.of_deviations(0.002, 0.008, 0.07, tails=math.inf)
    found = trials_from_transferred_errors(errors, [GRASP], count=4000).obj_T_est
    shift = found[:, :3, 3]
    expected = (2 * 0.002**2 + 0.008**2) / 3
    assert_allclose(np.cov(shift.T), expected * np.eye(3), atol=0.15 * expected)
    assert np.sqrt(np.mean(rotation_angle(found[:, :3, :3]) ** 2)) == pytest.approx(
        0.07 * math.sqrt(3), rel=0.05
    )
    again = trials_from_transferred_errors(errors, [GRASP], count=4000).obj_T_est
    assert np.array_equal(found, again)


def test_errors_of_covariances_keep_sizes_and_relations() -> None:
    # A turn about z always comes with a shift along x.
    covariance = np.diag([1e-4, 1e-6, 1e-6, 1e-4, 1e-4, 1e-2])
    covariance[0, 5] = covariance[5, 0] = 0.99e-3
    table = CovarianceTable(np.array(["mine-3"]), covariance[None], "covariances.csv")
    errors = PoseErrors.of_covariances(table, tails=math.inf)
    assert_allclose(np.cov(errors.truth.T), covariance, atol=3e-4)
    assert np.corrcoef(errors.truth[:, 0], errors.truth[:, 5])[0, 1] > 0.98
    assert "covariances.csv" in errors.sources["drawn errors"]


def test_errors_of_no_object_serve_for_every_object() -> None:
    errors = PoseErrors.of_deviations(0.002, 0.008, 0.07)
    assert len(trials_from_transferred_errors(errors, [GRASP], count=3)) == 3
    assert "Student's t with 4" in errors.sources["drawn errors"]


@pytest.mark.parametrize(
    ("given", "tails", "words"),
    [
        ((0.0, 0.008, 0.07), 4.0, "above zero"),
        ((2.0, 8.0, 4.0), 4.0, "at most 0.5 m"),
        ((0.002, 0.008, 0.07), 2.0, "more than 2"),
        ((0.002, 0.008, 0.07), math.nan, "should be a number"),
    ],
)
def test_what_cannot_be_drawn_is_refused(
    given: tuple[float, float, float], tails: float, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        PoseErrors.of_deviations(*given, tails=tails)


def test_estimates_without_ground_truth_have_no_known_errors() -> None:
    with pytest.raises(MismatchError, match="estimates of made have no ground truth"):
        PoseErrors.of_estimates({"made": {"a": results_of(random_poses(3))}}, {})
    with pytest.raises(InputError, match="no estimates"):
        PoseErrors.of_estimates({}, {})
