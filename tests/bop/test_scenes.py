"""Scene folders of a split: of several cameras, of splits with a type."""

from __future__ import annotations

from pathlib import Path

import pytest
from numpy.testing import assert_array_equal

from bop_images import FOCAL, IMAGES, write_dataset
from graspcast.bop.camera_poses import read_scene_camera_poses
from graspcast.bop.dataset import BopDataset
from graspcast.bop.ground_truth import read_ground_truth
from graspcast.bop.scenes import Scenes, find_split, sensors_in
from graspcast.errors import FormatError, InputError, UnknownNameError
from scene_files import entry, name_sensor, write_scene


def test_images_and_scenes_under_two_spellings_are_refused(tmp_path: Path) -> None:
    scenes = write_scene(tmp_path, {"0": [entry()], "00": [entry()]}, scene=1)
    with pytest.raises(FormatError, match="the keys '0' and '00' are the same image"):
        read_ground_truth(scenes)
    write_scene(tmp_path, {"0": [entry()]}, scene=1)
    (scenes / "000001").rename(scenes / "1")
    write_scene(tmp_path, {"0": [entry()]}, scene=1)
    with pytest.raises(InputError, match="another folder here is scene 1 too"):
        read_ground_truth(scenes)


def test_the_only_camera_is_found(tmp_path: Path) -> None:
    made = write_dataset(tmp_path / "made")
    name_sensor(write_dataset(tmp_path / "named").scenes, "cam1")
    for sensor in (None, "cam1"):
        dataset = BopDataset(tmp_path / "named", sensor=sensor)
        assert_array_equal(dataset.ground_truth.cam_T_obj, made.ground_truth.cam_T_obj)
        assert_array_equal(dataset.ground_truth.visib_fract, made.ground_truth.visib_fract)
        assert dataset.camera_of(1, 3).K[0, 0] == FOCAL
        assert tuple(sorted(dataset.images)) == IMAGES
        assert dataset.images[1, 3].parent.name == "rgb_cam1"
        assert dataset.has_ground_truth and dataset.has_images
    with pytest.raises(UnknownNameError, match=r"unknown camera 'cam2'.*; known: cam1"):
        BopDataset(tmp_path / "named", sensor="cam2").ground_truth  # noqa: B018
    # One camera without a name is the only one, whatever it is called.
    assert len(BopDataset(tmp_path / "made", sensor="cam1").ground_truth) == 6


def test_of_several_cameras_one_is_named(tmp_path: Path) -> None:
    scenes = write_scene(tmp_path, {"0": [entry(1)]})
    name_sensor(scenes, "cam1")
    write_scene(tmp_path, {"0": [entry(2)], "1": [entry(2)]})
    (scenes / "000001" / "scene_gt.json").rename(scenes / "000001" / "scene_gt_photoneo.json")
    assert sensors_in(scenes) == ["cam1", "photoneo"]
    with pytest.raises(InputError, match="several cameras, cam1, photoneo; name one") as caught:
        read_ground_truth(scenes)
    assert caught.value.parameters == ("sensor",)
    assert read_ground_truth(Scenes.find(scenes, "photoneo")).obj_id.tolist() == [2, 2]
    with pytest.raises(InputError, match=r"has a scene_camera_cam1\.json"):
        read_scene_camera_poses(scenes, "cam1")


def test_grey_images_are_read_where_there_are_no_others(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path, ".tif")
    assert dataset.image(1, 3).shape == (64, 96, 3)
    for scene in dataset.scenes.iterdir():
        (scene / "rgb").rename(scene / "gray")
    assert tuple(sorted(BopDataset(tmp_path).images)) == IMAGES


def test_splits_with_a_type(tmp_path: Path) -> None:
    assert find_split(tmp_path).name == "test"
    (tmp_path / "test_kinect").mkdir()
    assert find_split(tmp_path).name == "test_kinect"
    (tmp_path / "test_primesense").mkdir()
    with pytest.raises(InputError, match="has several splits, test_kinect, test_primesense;"):
        find_split(tmp_path)
    assert find_split(tmp_path, "test-primesense").name == "test_primesense"
    assert find_split(tmp_path, "val").name == "val"
    (tmp_path / "test").mkdir()
    assert find_split(tmp_path).name == "test"
