"""BOP datasets: ground truth, cameras and targets of a directory."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from bop_images import write_dataset
from graspcast.bop.dataset import BopDataset, read_ground_truth, read_targets
from graspcast.bop.models import read_models_info
from graspcast.errors import GraspcastError, InputError
from poses import write_models
from scene_files import entry, write_scene


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


def test_directories_without_scenes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such directory"):
        BopDataset(tmp_path / "none")
    with pytest.raises(InputError, match=r"no scene folder here has a scene_gt\.json"):
        read_ground_truth(tmp_path)
    with pytest.raises(InputError, match=r"models_info\.json here"):
        BopDataset(tmp_path).models  # noqa: B018


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


def test_splits_and_models_of_other_names_are_named(tmp_path: Path) -> None:
    made = write_dataset(tmp_path / "made")
    (made.root / "test").rename(made.root / "val")
    with pytest.raises(
        InputError, match=r"made/test: no such.*there is .*made/val; give"
    ) as caught:
        _ = made.ground_truth
    assert "ground_truth" in caught.value.parameters
    (made.root / "models").rename(made.root / "models_v2")
    with pytest.raises(InputError, match=r"no models/models_info.json here; there is models_v2;"):
        _ = BopDataset(made.root).models


def test_ground_truth_is_read_where_a_camera_is_wrong(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path)
    camera = dataset.root / "test" / "000002" / "scene_camera.json"
    camera.write_text(json.dumps({"3": {"cam_K": [0] * 9}}))
    assert len(BopDataset(tmp_path).ground_truth.obj_id) == 6
    with pytest.raises(GraspcastError, match=r"scene_camera\.json"):
        BopDataset(tmp_path).camera_of(2, 3)
