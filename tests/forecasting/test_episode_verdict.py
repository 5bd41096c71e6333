"""The verdict on one object after a look."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.forecasting.episode_verdict import EpisodeVerdict, from_where
from graspcast.forecasting.verdict import Verdict
from graspcast.pose.transforms import invert
from graspcast.views.look import Look
from graspcast.views.tracks import Track
from static_scenes import objects, orbit

CAMERAS = orbit(3, degrees=30.0)


def test_the_reason_includes_the_notes() -> None:
    verdict = EpisodeVerdict(
        0, "d-1", Verdict(True, 0.9, "sure"), "a", np.eye(4), None, 1, 2, notes=("one", "two")
    )
    assert verdict.reason == "sure; one; two"
    assert (str(verdict), verdict.attempt, verdict.probability) == ("attempt", True, 0.9)
    assert verdict.look is None


def test_from_where_to_look_at_what_was_seen_before() -> None:
    looks = [Look({}, camera) for camera in CAMERAS[:2]]
    world_T_obj = objects(1)[0]
    covariance = np.diag(np.square([0.003, 0.003, 0.02, 0.07, 0.07, 0.07]))
    look = from_where(Track(0, world_T_obj, covariance), looks)
    assert look is not None
    assert look.axis_sd_m == pytest.approx(0.02)
    np.testing.assert_allclose(np.abs(CAMERAS[1][:3, :3] @ look.axis), [0, 0, 1], atol=1e-9)
    assert look.direction_world is not None
    position = world_T_obj[:3, 3]
    for camera in CAMERAS[:2]:
        towards = (camera[:3, 3] - position) / np.linalg.norm(camera[:3, 3] - position)
        assert np.arccos(towards @ look.direction_world) > np.deg2rad(12) - 1e-9
    np.testing.assert_allclose(
        look.direction, invert(CAMERAS[1])[:3, :3] @ look.direction_world, atol=1e-9
    )


def test_without_camera_poses_it_is_not_known() -> None:
    covariance = np.eye(6)
    assert from_where(Track(0, None, covariance), [Look({}, CAMERAS[0])]) is None
    assert from_where(Track(0, objects(1)[0], covariance), [Look({})]) is None
