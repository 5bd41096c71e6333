"""Cameras of a BOP dataset: of all images, of a type, and of one image."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bop_images import FOCAL, IMAGES, SIZE, write_dataset, write_image
from graspcast.bop.dataset import BopDataset
from graspcast.errors import FormatError, InputError
from scene_files import entry, write_scene


def test_cameras(tmp_path: Path) -> None:
    (tmp_path / "camera.json").write_text(
        json.dumps({"fx": 500, "fy": 510, "cx": 320, "cy": 240, "depth_scale": 0.1})
    )
    folder = write_scene(tmp_path, {"3": [entry()]}) / "000001"
    dataset = BopDataset(tmp_path)
    assert_array_equal(dataset.camera.K, [[500, 0, 320], [0, 510, 240], [0, 0, 1]])
    assert dataset.camera.depth_scale_m == 0.0001
    assert dataset.camera_of(1, 3) is dataset.camera
    (folder / "scene_camera.json").write_text(
        json.dumps({"3": {"cam_K": [400, 0, 200, 0, 300, 150, 0, 0, 1]}})
    )
    own = [[400, 0, 200], [0, 300, 150], [0, 0, 1]]
    assert_array_equal(BopDataset(tmp_path).camera_of(1, 3).K, own)
    assert BopDataset(tmp_path).camera_of(1, 99).K[0, 0] == 500


def test_the_common_camera_is_read_only_for_images_without_their_own(tmp_path: Path) -> None:
    made = write_dataset(tmp_path / "made")
    assert (made.root / "test" / "000001" / "scene_camera.json").is_file()
    (made.root / "camera.json").unlink()
    assert made.camera_of(1, 3).K[0, 0] == FOCAL
    with pytest.raises(FormatError, match=r"camera\.json"):
        made.camera_of(1, 4)


def write_camera(path: Path, focal: float, size: tuple[int, int] = SIZE) -> None:
    entries = {"fx": focal, "fy": focal, "cx": size[0] / 2, "cy": size[1] / 2}
    path.write_text(json.dumps({**entries, "width": size[0], "height": size[1]}))


def without_own(root: Path) -> None:
    for path in root.glob("test*/*/scene_camera.json"):
        path.unlink()


def test_the_only_camera_of_a_type_is_taken(tmp_path: Path) -> None:
    write_dataset(tmp_path)
    (tmp_path / "camera.json").rename(tmp_path / "camera_uw.json")
    without_own(tmp_path)
    dataset = BopDataset(tmp_path)
    assert dataset.image_size == SIZE
    assert dataset.camera_of(1, 3).K[0, 0] == FOCAL
    write_camera(tmp_path / "camera_cmu.json", 500.0)
    dataset = BopDataset(tmp_path)
    assert dataset.image_size == SIZE, "both have it"
    with pytest.raises(InputError, match=r"which camera, camera_cmu.json or camera_uw.json\?"):
        dataset.camera_of(1, 3)
    write_camera(tmp_path / "camera_uw.json", FOCAL, (2 * SIZE[0], SIZE[1]))
    assert BopDataset(tmp_path).image_size is None


def test_the_camera_of_the_type_of_the_split_is_taken(tmp_path: Path) -> None:
    write_dataset(tmp_path)
    without_own(tmp_path)
    (tmp_path / "test").rename(tmp_path / "test_primesense")
    (tmp_path / "camera.json").rename(tmp_path / "camera_primesense.json")
    write_camera(tmp_path / "camera_kinect.json", 300.0, (720, 540))
    for split in (None, "test_primesense", "test-primesense"):
        dataset = BopDataset(tmp_path, split=split)
        assert (dataset.image_size, dataset.camera_of(1, 3).K[0, 0]) == (SIZE, FOCAL)


def test_an_image_of_another_size_needs_intrinsics_of_its_own(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path)
    write_image(dataset.images[2, 3], size=(192, 128))
    with pytest.raises(FormatError, match=r"says 96 x 64.* cam_K .*is that of camera.json"):
        dataset.image(2, 3)
    path = tmp_path / "test" / "000002" / "scene_camera.json"
    for principal, says in (((96, 64), ""), ((200, 64), "principal point of its cam_K")):
        K = [2 * FOCAL, 0, principal[0], 0, 2 * FOCAL, principal[1], 0, 0, 1]
        path.write_text(json.dumps({"3": {"cam_K": K}}))
        dataset = BopDataset(tmp_path)
        assert dataset.size_of(2, 3) == (192, 128)
        assert dataset.size_of(1, 3) == SIZE
        if says:
            with pytest.raises(FormatError, match=says):
                dataset.image(2, 3)
        else:
            assert dataset.image(2, 3).shape == (128, 192, 3)
    path.write_text("{}")
    with pytest.raises(FormatError, match="has no cam_K of its own for it"):
        BopDataset(tmp_path).image(2, 3)


def test_intrinsics_are_held_against_the_size_of_their_image(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path)
    path = tmp_path / "test" / "000002" / "scene_camera.json"
    K = [FOCAL * 10, 0, 480, 0, FOCAL * 10, 320, 0, 0, 1]
    path.write_text(json.dumps({"3": {"cam_K": K}}))
    with pytest.raises(FormatError, match="far outside the image of 96x64"):
        dataset.camera_of(2, 3)
    write_image(dataset.images[2, 3], size=(960, 640))
    assert BopDataset(tmp_path).camera_of(2, 3).K[0, 2] == 480
    assert len(BopDataset(tmp_path).scene_cameras) == len(IMAGES)
    assert np.isfinite(BopDataset(tmp_path).camera.K).all()


def test_a_common_camera_that_cannot_be_one_is_refused(tmp_path: Path) -> None:
    write_dataset(tmp_path)
    write_camera(tmp_path / "camera.json", 1.2)
    with pytest.raises(FormatError, match=r"camera\.json: has focal lengths 1\.2 .* not in pixels"):
        BopDataset(tmp_path).camera  # noqa: B018


def test_sizes_of_images_are_their_files_where_they_can_be_read(tmp_path: Path) -> None:
    write_dataset(tmp_path)
    wide = write_image(tmp_path / "test" / "000001" / "rgb" / "000003.png", size=(192, 128))
    assert BopDataset(tmp_path).size_of(1, 3) == (192, 128)
    wide.write_bytes(b"no image")
    assert BopDataset(tmp_path).size_of(1, 3) == SIZE
    without_own(tmp_path)
    assert BopDataset(tmp_path).size_of(1, 3) == SIZE
