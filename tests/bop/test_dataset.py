"""BOP datasets: ground truth, cameras and targets of a directory."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from bop_images import FOCAL, write_dataset
from graspcast.bop.dataset import BopDataset, Target, read_ground_truth, read_targets
from graspcast.bop.models import read_models_info
from graspcast.errors import FormatError, GraspcastError, InputError
from poses import write_models

EYE = [1, 0, 0, 0, 1, 0, 0, 0, 1]


def entry(obj_id: int = 1, **changes: Any) -> dict[str, Any]:
    return {"cam_R_m2c": EYE, "cam_t_m2c": [0, 0, 900], "obj_id": obj_id} | changes


def write_scene(root: Path, images: Any, info: Any = None, scene: int = 1) -> Path:
    folder = root / "test" / f"{scene:06d}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene_gt.json").write_text(json.dumps(images))
    if info is not None:
        (folder / "scene_gt_info.json").write_text(json.dumps(info))
    return folder.parent


def test_ground_truth_of_several_scenes_and_instances(tmp_path: Path) -> None:
    write_scene(tmp_path, {"7": [entry(1), entry(2), entry(1)]}, scene=2)
    write_scene(tmp_path, {"4": [entry(5)]}, {"4": [{"visib_fract": 0.25}]}, scene=1)
    gt = BopDataset(tmp_path).ground_truth
    assert gt.scene_id.tolist() == [1, 2, 2, 2]
    assert gt.obj_id.tolist() == [5, 1, 2, 1]
    assert gt.gt_id.tolist() == [0, 0, 1, 2]
    assert gt.visib_fract[0] == 0.25
    assert np.isnan(gt.visib_fract[1:]).all()
    assert gt.cam_T_obj[0, 2, 3] == 0.9


def test_slightly_bad_true_rotations_are_projected(tmp_path: Path) -> None:
    scenes = write_scene(tmp_path, {"0": [entry(cam_R_m2c=[*EYE[:8], 1.008])]})
    assert_array_equal(read_ground_truth(scenes).cam_T_obj[0, :3, :3], np.eye(3))


@pytest.mark.parametrize(
    ("images", "says"),
    [
        ({"0": [entry(cam_R_m2c=[*EYE[:8], 1.1])]}, "image 0, object 1: cam_R_m2c is 0.1 away"),
        ({"0": [entry(cam_t_m2c=[0, 0])]}, "image 0, instance 0: should be 3 finite numbers"),
        ({"0": [{"obj_id": 1}]}, "no 'cam_R_m2c'; found obj_id"),
        ({"x": [entry()]}, "'x' is not a whole number"),
        ({"0": entry()}, "image 0: should be a list of instances"),
        ({"0": [3]}, "image 0, instance 0: should be an object"),
        ({"0": [entry(obj_id=1.5)]}, "1.5 is not a whole number"),
        ([], "should hold an object at its top level"),
    ],
)
def test_wrong_ground_truth_is_named(tmp_path: Path, images: Any, says: str) -> None:
    scenes = write_scene(tmp_path, images)
    with pytest.raises(FormatError) as caught:
        read_ground_truth(scenes)
    assert says in str(caught.value)
    assert "scene_gt.json" in str(caught.value)


def test_visibility_must_match_the_instances(tmp_path: Path) -> None:
    scenes = write_scene(tmp_path, {"0": [entry()]}, {"0": []})
    with pytest.raises(FormatError, match="should list 1 instances"):
        read_ground_truth(scenes)


def test_directories_without_scenes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such directory"):
        BopDataset(tmp_path / "none")
    with pytest.raises(InputError, match=r"no scene folder here has a scene_gt\.json"):
        read_ground_truth(tmp_path)
    with pytest.raises(InputError, match=r"models_info\.json here"):
        BopDataset(tmp_path).models  # noqa: B018


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


def test_targets_of_both_formats(tmp_path: Path) -> None:
    path = tmp_path / "targets.json"
    path.write_text(
        json.dumps(
            [{"scene_id": 1, "im_id": 2, "obj_id": 3, "inst_count": 4}, {"scene_id": 5, "im_id": 6}]
        )
    )
    assert read_targets(path) == [Target(1, 2, 3, 4), Target(5, 6)]
    path.write_text(json.dumps([{"scene_id": 1}]))
    with pytest.raises(FormatError, match="entry 0: no 'im_id'; found scene_id"):
        read_targets(path)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(
                ["0", "1", "obj_id", "cam_R_m2c", "cam_t_m2c", "diameter", "scene_id", "im_id"]
            ),
            inner,
            max_size=4,
        )
    ),
    max_leaves=12,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=100)
@given(JSON, st.binary(max_size=60), st.booleans())
def test_any_json_is_read_or_refused(tmp_path: Path, value: Any, raw: bytes, broken: bool) -> None:
    scenes = write_scene(tmp_path, {})
    path = scenes / "000001" / "scene_gt.json"
    path.write_bytes(raw if broken else json.dumps(value).encode())
    for read in (
        lambda: read_ground_truth(scenes),
        lambda: read_models_info(path),
        lambda: read_targets(path),
    ):
        try:
            read()
        except GraspcastError as error:
            assert "scene_gt.json" in str(error)


def test_the_official_ground_truth_is_read(data_dir: Path) -> None:
    gt = BopDataset(data_dir / "bop" / "lmo").ground_truth
    assert len(gt) == 1517
    rotation = gt.cam_T_obj[:, :3, :3]
    assert_allclose(
        rotation @ np.swapaxes(rotation, 1, 2),
        np.broadcast_to(np.eye(3), rotation.shape),
        atol=2e-5,
    )
    assert (gt.visib_fract >= 0).all()


def test_representations_are_short(tmp_path: Path) -> None:
    scenes = write_scene(tmp_path / "made", {"1": [entry(), entry(2)], "7": [entry()]})
    write_models(tmp_path / "made" / "models")
    dataset = BopDataset(tmp_path / "made", ground_truth=scenes)
    assert repr(dataset) == f"BopDataset(made, {scenes})"
    assert (
        repr(dataset.ground_truth)
        == f"GroundTruth(3 poses of 2 objects in 2 images, {scenes.name})"
    )
    assert repr(dataset.models) == f"Models(1 object, {tmp_path / 'made' / 'models'})"
    assert repr(dataset.models.mesh(1)) == "Mesh(8 vertices, 2 faces)"


def test_images_and_scenes_under_two_spellings_are_refused(tmp_path: Path) -> None:
    scenes = write_scene(tmp_path, {"0": [entry()], "00": [entry()]}, scene=1)
    with pytest.raises(FormatError, match="the keys '0' and '00' are the same image"):
        read_ground_truth(scenes)
    write_scene(tmp_path, {"0": [entry()]}, scene=1)
    (scenes / "000001").rename(scenes / "1")
    write_scene(tmp_path, {"0": [entry()]}, scene=1)
    with pytest.raises(InputError, match="another folder here is scene 1 too"):
        read_ground_truth(scenes)


def test_splits_and_models_of_other_names_are_named(tmp_path: Path) -> None:
    made = write_dataset(tmp_path / "made")
    (made.root / "test").rename(made.root / "val")
    with pytest.raises(
        InputError, match=r"made/test: no such.*there is .*made/val; give"
    ) as caught:
        _ = made.ground_truth
    assert "ground_truth" in caught.value.parameters
    (made.root / "models").rename(made.root / "models_cad")
    with pytest.raises(InputError, match=r"no models/models_info.json here; there is models_cad;"):
        _ = BopDataset(made.root).models


def test_the_common_camera_is_read_only_for_images_without_their_own(tmp_path: Path) -> None:
    made = write_dataset(tmp_path / "made")
    assert (made.root / "test" / "000001" / "scene_camera.json").is_file()
    (made.root / "camera.json").unlink()
    assert made.camera_of(1, 3).K[0, 0] == FOCAL
    with pytest.raises(FormatError, match=r"camera\.json"):
        made.camera_of(1, 4)
