"""The view model: draws around the fused pose, novelty, and its file."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.forecasting.models.design_matrix import ViewMatrix, nearest_to
from graspcast.forecasting.models.two_stage import SuccessGivenError
from graspcast.forecasting.models.view_model import ViewModel
from graspcast.pose.ray_frame import error_along, obj_R_ray
from graspcast.pose.transforms import compose, invert
from graspcast.views.statistics import RESIDUALS
from looked_at import Training, training


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Training:
    return training(tmp_path_factory.mktemp("given"))


@pytest.fixture(scope="module")
def matrix(given: Training) -> ViewMatrix:
    assert given.data.views is not None
    return ViewMatrix.of(given.data, given.data.views, given.models)


@pytest.fixture(scope="module")
def model(matrix: ViewMatrix) -> ViewModel:
    return ViewModel.fit(
        matrix.statistics, matrix.truth, matrix.row, matrix.views, trees=16, seed=0
    )


@pytest.fixture(scope="module")
def stage(given: Training, matrix: ViewMatrix) -> SuccessGivenError:
    estimates = given.data.estimates
    errors = compose(invert(given.data.truth)[None], estimates.cam_T_obj).reshape(-1, 4, 4)
    numbers = np.tile(estimates.obj_id - 1, 3)
    return SuccessGivenError.fit(
        errors, numbers, given.data.success.ravel() == 1, codes=np.eye(2), trees=16, seed=0
    )


def test_a_forecast_is_the_mean_over_draws_of_the_error_of_whoever_guides(
    given: Training, matrix: ViewMatrix, model: ViewModel, stage: SuccessGivenError
) -> None:
    rows = np.arange(0, len(matrix.row), 37)
    numbers = (given.data.estimates.obj_id - 1)[matrix.row[rows]]
    for k in (0, 2):
        F, G = matrix.fused[k, rows], matrix.guide[k, rows]
        asked = (matrix.statistics[rows], F, G, numbers)
        found = model.raw(stage, *asked, draws=64)
        draws = model.errors.draws(matrix.statistics[rows], 64)
        around = error_along(
            obj_R_ray(F)[:, None], np.linalg.norm(F[:, None, :3, 3], axis=-1), draws
        )
        errors = compose(around, compose(invert(F), G)[:, None])
        every = stage.probability(errors.reshape(-1, 4, 4), np.repeat(numbers, 64))
        # The forecast evaluates a few trees of the second stage for each draw, this all of them.
        assert_allclose(found, every.reshape(-1, 64).mean(axis=1), atol=0.12)
        assert np.corrcoef(found, every.reshape(-1, 64).mean(axis=1))[0, 1] > 0.95


def test_the_fused_pose_guides_better_than_one_view(
    given: Training, matrix: ViewMatrix, model: ViewModel, stage: SuccessGivenError
) -> None:
    rows = np.flatnonzero(matrix.views == 3)
    numbers = (given.data.estimates.obj_id - 1)[matrix.row[rows]]
    poses = matrix.fused[0, rows]
    both = [
        model.raw(stage, matrix.statistics[rows], poses, guide, numbers, draws=64).mean()
        for guide in (poses, matrix.guide[0, rows])
    ]
    assert both[0] > both[1] + 0.1


def test_residuals_beyond_those_of_training_are_novel(matrix: ViewMatrix, model: ViewModel) -> None:
    usual = matrix.statistics[matrix.views == 3]
    known = [given.p_value for given in model.assess(usual)]
    assert np.mean(np.array(known) <= 0.1) < 0.2
    odd = usual[:5].copy()
    odd[:, RESIDUALS] += 5.0
    for given in model.assess(odd):
        assert given.p_value == given.smallest and "differ more than in training" in given.excess


def test_it_is_restored_and_what_is_none_is_refused(model: ViewModel, matrix: ViewMatrix) -> None:
    arrays = model.to_arrays("views")
    back = ViewModel.from_arrays(arrays, "views")
    assert_array_equal(back.scores, model.scores)
    draws = (m.errors.draws(matrix.statistics[:4], 8) for m in (back, model))
    assert_array_equal(next(draws), next(draws))
    for name, wrong in (
        ("scale", np.zeros(len(RESIDUALS))),
        ("scores", model.scores[::-1].copy()),
        ("calibration", np.array([np.nan, 0.0])),
        ("centre", np.zeros(3)),
    ):
        with pytest.raises(ValueError, match="view model"):
            ViewModel.from_arrays({**arrays, f"views/{name}": wrong}, "views")


def test_of_symmetric_fused_poses_the_nearest_to_the_guide_is_taken(given: Training) -> None:
    poses = given.data.estimates.of("a")[:6]
    of = (given.data.estimates.dataset[:6], given.data.estimates.obj_id[:6], given.models)
    assert_allclose(nearest_to(poses, poses, *of), poses, atol=1e-12)
