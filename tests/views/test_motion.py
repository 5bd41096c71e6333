"""Any object with the methods of Motion serves, also one whose motion differs by object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from graspcast.views.camera_motion import CameraMotion, CameraNoise
from graspcast.views.fused_estimates import fuse_estimates
from graspcast.views.motion import Motion, ViewMotions
from static_scenes import estimates_of, motion_of, objects, orbit, scattered, seen

CAMERAS = orbit(8)
RESULTS = {"a": estimates_of(scattered(seen(CAMERAS, objects(2)), 0))}


@dataclass
class OfFirstObject:
    """Motion for object 1 alone; of image 7 it is known badly."""

    cameras: CameraMotion = field(default_factory=lambda: motion_of(CAMERAS))
    source: str = "a test"

    @property
    def scenes(self) -> set[int]:
        return self.cameras.scenes

    def views_of(
        self, scene_id: int, im_id: int, obj_id: int, others: Sequence[int]
    ) -> ViewMotions:
        if obj_id != 1:
            none = self.cameras.views_of(scene_id, im_id, obj_id, [])
            return ViewMotions(
                none.im_id, none.cam_T_view, none.noise, {"of object 2": len(others)}, "are new"
            )
        found = self.cameras.views_of(scene_id, im_id, obj_id, others)
        noise = np.where(found.im_id[:, None] == 7, 1e200, [0.001, 0.002])
        return ViewMotions(found.im_id, found.cam_T_view, noise)


def test_a_motion_of_ones_own() -> None:
    motion = OfFirstObject()
    assert isinstance(motion, Motion) and isinstance(motion.cameras, Motion)
    found = fuse_estimates(
        RESULTS, motion, dataset="d", views_from="all", noise=CameraNoise(0.0, 0.001)
    )
    first = found.instances.obj_id == 1
    assert (found.views[~first] == 1).all() and (found.views[first] == 3).all()
    assert "left out 56 views of object 2" in found.summary()
    assert "single views: 8 instances are new" in found.summary()
    noise, images = found.gathered.noise[first], found.gathered.view_im_id[first]
    np.testing.assert_allclose(noise[:, 1:][images[:, 1:] != 7][:, 0], 0.001)
    np.testing.assert_allclose(noise[:, 1:][images[:, 1:] != 7][:, 1], np.hypot(0.001, 0.002))


def test_a_view_known_badly_adds_nothing() -> None:
    found = fuse_estimates(RESULTS, OfFirstObject(), dataset="d", views_from="all", max_views=2)
    alone = fuse_estimates(RESULTS, None, dataset="d")
    rows = found.gathered.view_im_id[:, 1] == 7
    assert rows.any()
    gap = found.poses.cam_T_obj[rows] - alone.poses.cam_T_obj[rows]
    assert np.abs(gap).max() < 1e-5
    assert np.isfinite(found.poses.covariance).all()
