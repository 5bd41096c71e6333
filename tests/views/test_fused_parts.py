"""Fusion of the instances of several principals."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.errors import InputError
from graspcast.views.fused_estimates import fuse_estimates
from graspcast.views.fused_parts import fuse_estimates_by
from static_scenes import estimates_of, motion_of, objects, orbit, scattered, seen

CAMERAS = orbit(6, degrees=35.0)
POSES = seen(CAMERAS, objects(2))
TABLES = {name: estimates_of(scattered(POSES, k)) for k, name in enumerate("ab")}


def test_every_object_in_an_image_is_fused_once_by_the_first_that_has_it() -> None:
    a = TABLES["a"]
    some = TABLES | {"a": a.select((a.im_id != 3) | (a.obj_id != 1))}
    motion = motion_of(CAMERAS)
    first, second = fuse_estimates_by(some, ["a", "b"], motion, dataset="d", views_from="all")
    assert (first.principal, second.principal) == ("a", "b")
    (key,) = second.instances.to_keys()
    assert (key.im_id, key.obj_id) == (3, 1) and len(first) == 11
    # It is fused as it would be with its own principal.
    whole = fuse_estimates(some, motion, dataset="d", principal="b", views_from="all")
    i = whole.instances.to_keys().index(key)
    np.testing.assert_array_equal(second.poses.cam_T_obj[0], whole.poses.cam_T_obj[i])
    alone = fuse_estimates(some, motion, dataset="d", principal="a", views_from="all")
    np.testing.assert_array_equal(first.poses.cam_T_obj, alone.poses.cam_T_obj)


def test_a_principal_without_estimates_is_passed_over() -> None:
    a = TABLES["a"]
    none = a.select(a.im_id < 0)
    (part,) = fuse_estimates_by(TABLES | {"a": none}, ["a", "b"], dataset="d", max_views=1)
    assert part.principal == "b" and len(part) == 12
    with pytest.raises(InputError, match="none of a, b has an estimate to fuse"):
        fuse_estimates_by({"a": none, "b": none}, ["a", "b"], dataset="d", max_views=1)
    with pytest.raises(InputError, match="a has no estimate to fuse"):
        fuse_estimates_by(TABLES | {"a": none}, ["a"], dataset="d", max_views=1)
