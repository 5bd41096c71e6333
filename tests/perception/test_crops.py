"""The square around a detection: where its pixels come from, and poses in its terms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.perception.crops import Crop, crop_around_box, ray_rotation, resample
from graspcast.pose.transforms import rotation_angle
from poses import random_poses

K = np.array([[572.4, 0.0, 325.3], [0.0, 573.6, 242.0], [0.0, 0.0, 1.0]])
crops = st.builds(Crop, u=st.floats(-50, 700), v=st.floats(-50, 530), side=st.floats(20, 400))


@given(crop=crops, seed=st.integers(0, 10**6))
def test_a_pose_survives_being_said_in_the_crop_s_terms(crop: Crop, seed: int) -> None:
    pose = random_poses(1, seed, depth_m=0.9)[0]
    rotation, site = crop.encode_pose(pose, K, 0.2)
    np.testing.assert_allclose(crop.decode_pose(rotation, site, K, 0.2), pose, atol=1e-9)


@given(crop=crops)
def test_the_ray_of_the_middle_is_the_axis_turned_as_little_as_possible(crop: Crop) -> None:
    rotation = ray_rotation(crop, K)
    ray = np.linalg.inv(K) @ [crop.u, crop.v, 1.0]
    np.testing.assert_allclose(rotation[:, 2], ray / np.linalg.norm(ray), atol=1e-12)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    angle = np.arccos(np.clip(rotation[2, 2], -1, 1))
    np.testing.assert_allclose(rotation_angle(rotation), angle, atol=1e-6)


def test_an_object_carried_around_the_camera_looks_the_same_and_is_said_the_same() -> None:
    # The crop of a carried object sees it under the carried ray: its allocentric terms stay.
    pose = random_poses(1, 3)[0]
    pose[:3, 3] = [0.0, 0.0, 1.0]
    straight = Crop(K[0, 2], K[1, 2], 100.0)
    aside = Crop(600.0, 100.0, 100.0)
    carried = np.eye(4)
    carried[:3, :3] = ray_rotation(aside, K)
    before, _ = straight.encode_pose(pose, K, 0.2)
    after, site = aside.encode_pose(carried @ pose, K, 0.2)
    np.testing.assert_allclose(after, before, atol=1e-12)
    np.testing.assert_allclose(site[:2], 0.0, atol=1e-9)


def test_a_box_of_pixels_has_its_middle_between_its_first_and_last() -> None:
    crop = crop_around_box(np.array([10.0, 20.0, 5.0, 3.0]), margin=1.0)
    assert (crop.u, crop.v, crop.side) == (12.0, 21.0, 5.0)


def test_at_its_own_size_a_crop_is_the_part_of_the_image() -> None:
    image = np.random.default_rng(0).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    crop = crop_around_box(np.array([11.0, 7.0, 32.0, 32.0]), margin=1.0)
    np.testing.assert_array_equal(resample(image, crop, 32), image[7:39, 11:43])


def test_beyond_the_border_it_is_black() -> None:
    image = np.full((40, 40, 3), 200, dtype=np.uint8)
    seen = resample(image, crop_around_box(np.array([-16.0, 0.0, 32.0, 32.0]), margin=1.0), 32)
    assert (seen[:, :16] == 0).all() and (seen[:, 16:] == 200).all()


@given(crop=st.builds(Crop, u=st.floats(60, 140), v=st.floats(60, 140), side=st.floats(20, 70)))
def test_a_ramp_tells_where_each_pixel_is_from(crop: Crop) -> None:
    # A linear image is resampled without error but rounding, so its numbers are coordinates.
    middle = np.rint([crop.u, crop.v])
    column = 126 + 3 * (np.tile(np.arange(200), (200, 1)) - middle[0])
    row = 126 + 3 * (np.tile(np.arange(200), (200, 1)).T - middle[1])
    image = np.clip(np.stack([column, row, row], axis=-1), 0, 255).astype(np.uint8)
    size = 16
    axis = (np.arange(size) + 0.5) / size - 0.5
    u, v = np.meshgrid(axis, axis)
    place = crop.to_image(np.stack([u, v], axis=-1))
    seen = (resample(image, crop, size)[..., :2].astype(float) - 126) / 3 + middle
    np.testing.assert_allclose(seen, place, atol=0.4)


@pytest.mark.parametrize("place", [[-0.5, -0.5], [0.0, 0.25], [0.5, 0.5]])
def test_places_and_pixels_are_each_other_s_inverse(place: list[float]) -> None:
    crop = Crop(33.0, 44.0, 55.0)
    np.testing.assert_allclose(crop.from_image(crop.to_image(np.array(place))), place, atol=1e-12)
