"""Camera motion and its noise, checked where they come in."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from graspcast.errors import GraspcastError, InputError
from graspcast.pose.transforms import compose, invert
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from static_scenes import motion_of, orbit

POSE = orbit(1)[0]


def changed(**entries: float) -> np.ndarray:
    out = POSE.copy()
    for place, value in entries.items():
        out[int(place[1]), int(place[2])] = value
    return out


def test_motion_between_two_images() -> None:
    cameras = orbit(3)
    motion = motion_of(cameras, scene_id=7)
    np.testing.assert_allclose(
        motion.between(7, 0, 2), compose(invert(cameras[0]), cameras[2]), atol=1e-12
    )
    assert repr(motion) == "CameraMotion(3 images of 1 scene, camera poses)"
    with pytest.raises(InputError, match="no camera pose of image 7/9"):
        motion.between(7, 0, 9)


@pytest.mark.ill_typed
@pytest.mark.parametrize(
    ("pose", "says"),
    [
        (np.eye(3), "should be a 4x4 matrix, not of shape"),
        ("text", "should be a 4x4 matrix of numbers"),
        (changed(c03=np.nan), "not finite"),
        (changed(c30=1.0), "has the last row 1 0 0 1"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), "rotation scaled by 2"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "mirrored rotation"),
        (changed(c00=0.9), "no rotation matrix"),
        (changed(c03=1e6), "m from the world's origin.* subtract one offset"),
        (changed(c03=1e300), "1e.300 m from the world's origin"),
    ],
)
def test_a_pose_that_is_not_rigid_is_named(pose: Any, says: str) -> None:
    with pytest.raises(InputError, match=f"image 1/0: the camera's pose .*{says}"):
        CameraMotion.of([1], [0], [pose])


@pytest.mark.ill_typed
def test_wrong_keys_and_columns_are_refused() -> None:
    with pytest.raises(InputError, match="image 1/0 has more than one camera pose"):
        CameraMotion.of([1, 1], [0, 0], [POSE, POSE])
    with pytest.raises(InputError, match="2 camera poses for 1 images"):
        CameraMotion.of([1], [0], [POSE, POSE])
    with pytest.raises(InputError, match="one entry an image"):
        CameraMotion.of([1, 1], [0], [POSE])
    for key in ((1,), "ab", (1.5, 2), (True, 2)):
        with pytest.raises(InputError, match="a pair of whole numbers"):
            CameraMotion({key: POSE})  # type: ignore[dict-item]
    with pytest.raises(InputError, match="should be a mapping"):
        CameraMotion([POSE])  # type: ignore[arg-type]


def test_noise_is_parsed_with_its_units() -> None:
    noise = CameraNoise.parse("1.5mm, 0.1deg")
    assert noise.translation_m == pytest.approx(0.0015)
    assert noise.rotation_rad == pytest.approx(np.deg2rad(0.1))
    assert CameraNoise.parse("0.2cm,0.01rad") == CameraNoise(0.002, 0.01)


@pytest.mark.parametrize("text", ["", "1", "1,0.1", "1mm", "1mm,0.1", "1ft,1deg", "1mm,1deg,2"])
def test_noise_without_units_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"for example 1mm,0\.1deg"):
        CameraNoise.parse(text)


@pytest.mark.ill_typed
def test_noise_out_of_range_is_refused() -> None:
    for sizes in ((-0.1, 0.0), (0.0, 2.0), (float("nan"), 0.0), (float("inf"), 0.0)):
        with pytest.raises(InputError, match=r"should be (0 or more|a number)"):
            CameraNoise(*sizes)
    with pytest.raises(InputError, match="should be a number"):
        CameraNoise("1mm")  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["translation_m", "rotation_rad"])
def test_noise_is_from_0_to_1(name: str) -> None:
    for value in (0.0, 1.0):
        assert getattr(CameraNoise(**{name: value}), name) == value
    for value in (-1e-9, 1.001, float("nan"), float("inf")):
        with pytest.raises(InputError):
            CameraNoise(**{name: value})


@pytest.mark.parametrize("axis", range(3))
def test_a_transposed_camera_pose_is_told_from_another_last_row(axis: int) -> None:
    pose = orbit(1)[0]
    pose[:3, 3] = 0.0
    pose[axis, 3] = 0.7
    with pytest.raises(GraspcastError, match="not 0 0 0 1; it looks transposed"):
        CameraMotion.of([1], [0], pose.T[None])
    odd = pose.copy()
    odd[3, 1] = 0.5
    with pytest.raises(GraspcastError, match=r"last row 0 0\.5 0 1, not 0 0 0 1") as caught:
        CameraMotion.of([1], [0], odd[None])
    assert "transposed" not in str(caught.value)
