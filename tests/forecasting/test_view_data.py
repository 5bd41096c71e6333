"""Fused poses of training instances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from graspcast.errors import InputError, MismatchError
from graspcast.estimates.loading import Inputs
from graspcast.forecasting.view_data import TRAINING_VIEWS, fuse_for_training, view_data
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from looked_at import Training, fused, training


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Training:
    return training(tmp_path_factory.mktemp("given"))


def test_rows_follow_their_instances_through_selections(given: Training) -> None:
    data, views = given.data, given.data.views
    assert views is not None
    keys = data.estimates.instances.to_keys()
    some = fused(given.results, given.models, given.motion, 2)
    where = dict(zip(some.instances.to_keys(), some.poses.cam_T_obj, strict=True))
    of_two = np.flatnonzero(views.views == 2)[:5]
    for i in of_two:
        assert_array_equal(views.cam_T_fused[i], where[keys[views.row[i]]])
    mask = data.estimates.scene_id % 3 == 0
    for which in (mask, np.flatnonzero(mask)[::-1]):
        part = data.select(which)
        assert part.views is not None
        assert len(part.views) == mask[views.row].sum()
        mine = part.estimates.instances.to_keys()
        before = {(keys[r], p.tobytes()) for r, p in zip(views.row, views.cam_T_fused, strict=True)}
        after = {
            (mine[r], p.tobytes())
            for r, p in zip(part.views.row, part.views.cam_T_fused, strict=True)
        }
        assert after <= before
    assert data.only("c", "a", "b").views is not None
    assert data.only("a", "b").views is None


def test_training_instances_of_every_dataset_are_fused_from_one_to_five_views(
    given: Training,
) -> None:
    inputs = Inputs({}, {"d": given.results})
    noise = CameraNoise(0.001, 0.002)
    views = fuse_for_training(inputs, {"d": given.motion}, given.data.estimates, "a", noise=noise)
    assert set(views.views.tolist()) == {1, 2, 3, 5}
    assert len(views) == len(TRAINING_VIEWS) * len(given.data)
    assert views.rules["noise_m"] == 0.001 and views.rules["noise_rad"] == 0.002
    with pytest.raises(InputError, match="camera motion of e, but there are no estimates"):
        fuse_for_training(inputs, {"e": given.motion}, given.data.estimates, "a")


def test_without_several_views_there_is_nothing_to_learn(given: Training) -> None:
    one = fused(given.results, given.models, given.motion, 1)
    with pytest.raises(MismatchError, match="no training instance has a pose from several views"):
        view_data(given.data.estimates, [one], {})
    two = {name: given.results[name] for name in "ab"}
    other = fused(two, given.models, given.motion)
    with pytest.raises(MismatchError, match="fused from a, b, but the training data have"):
        view_data(given.data.estimates, [other], {})
    still = CameraMotion({(1, i): np.eye(4) for i in range(2)})
    assert replace(given.data, views=None).views is None and len(still.scenes) == 1
