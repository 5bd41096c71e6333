"""Networks in ONNX files, and the input checks of the estimators that use them."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections
from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.perception import BUILT_IN, built_in

WEIGHTS = Path(str(files("graspcast.perception"))) / "weights"


def test_what_ships_is_small_and_says_what_it_is() -> None:
    paths = [WEIGHTS / f"{name}.onnx" for name in BUILT_IN]
    assert sum(path.stat().st_size for path in paths) < 3_000_000
    for name in BUILT_IN:
        estimator = built_in(name)
        made = estimator.network.made  # type: ignore[attr-defined]
        assert made["steps"] > 0 and {"torch", "mujoco", "graspcast"} <= set(made)
        assert len(estimator.obj_ids) >= 5


@pytest.fixture(scope="module")
def dense_inputs(
    demo: BopDataset, demo_boxes: Detections
) -> tuple[np.ndarray, np.ndarray, Detections]:
    return demo.image(1, 0), demo.camera_of(1, 0).K, demo_boxes.images()[1, 0]


def changed(detections: Detections, **columns: np.ndarray) -> Detections:
    return replace(detections, **columns)


@pytest.mark.ill_typed
@pytest.mark.parametrize("name", BUILT_IN)
def test_bad_input_is_named(
    name: str, dense_inputs: tuple[np.ndarray, np.ndarray, Detections]
) -> None:
    image, K, seen = dense_inputs
    estimator = built_in(name)
    alpha = np.dstack([image, image[..., 0]])
    with pytest.raises(InputError, match="alpha channel"):
        estimator.estimate(alpha, K, seen)
    with pytest.raises(InputError, match=r"0 to 255.*float64"):
        estimator.estimate(image / 255, K, seen)
    with pytest.raises(InputError, match="3x3 matrix"):
        estimator.estimate(image, K * np.nan, seen)
    beside = changed(seen, box_xywh=seen.box_xywh + [640, 0, 0, 0])
    with pytest.raises(InputError, match=r"outside of the image, which has 640 x 480"):
        estimator.estimate(image, K, beside)
    empty = changed(seen, box_xywh=seen.box_xywh * [1, 1, 0, 1])
    with pytest.raises(InputError, match="is empty"):
        estimator.estimate(image, K, empty)
    with pytest.raises(UnknownNameError, match=r"unknown object '77'; known: 2, 3"):
        estimator.estimate(image, K, changed(seen, obj_id=np.full(len(seen), 77)))


def test_an_image_of_another_size_is_an_image(
    dense_inputs: tuple[np.ndarray, np.ndarray, Detections],
) -> None:
    # The estimators look at crops: a border around the image moves only the boxes and the camera.
    image, K, seen = dense_inputs
    inside = (seen.box_xywh[:, :2] > 40).all(axis=1)
    inside &= (seen.box_xywh[:, :2] + seen.box_xywh[:, 2:] < [600, 440]).all(axis=1)
    seen = seen.select(inside)
    assert len(seen)
    estimator = built_in("direct")
    wide = np.pad(image, ((30, 10), (50, 0), (0, 0)))
    shifted = K + [[0, 0, 50], [0, 0, 30], [0, 0, 0]]
    moved = changed(seen, box_xywh=seen.box_xywh + [50, 30, 0, 0])
    one, other = estimator.estimate(image, K, seen), estimator.estimate(wide, shifted, moved)
    np.testing.assert_allclose(other.cam_T_obj, one.cam_T_obj, atol=1e-6)


def test_weights_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="cannot be read"):
        built_in("dense", tmp_path / "none.onnx")
    (tmp_path / "text.onnx").write_text("not a network")
    with pytest.raises(FormatError, match="is not an ONNX network"):
        built_in("dense", tmp_path / "text.onnx")
    whole = (WEIGHTS / "dense.onnx").read_bytes()
    (tmp_path / "half.onnx").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FormatError, match="is not an ONNX network"):
        built_in("dense", tmp_path / "half.onnx")
    with pytest.raises(FormatError, match="weights of the estimator direct, not dense"):
        built_in("dense", WEIGHTS / "direct.onnx")
    with pytest.raises(UnknownNameError, match="known: dense, direct, keypoints"):
        built_in("epos")


def test_damaged_metadata_are_refused(tmp_path: Path) -> None:
    whole = (WEIGHTS / "dense.onnx").read_bytes()
    for old, new in (
        (b'"family"', b'"famine"'),
        (b'"diameter_m"', b'"diameter_x"'),
        (b'{"family"', b'["family"'),
        (b'"pixels": 64', b'"pixels": {}'),
    ):
        assert whole.count(old) >= 1
        (tmp_path / "damaged.onnx").write_bytes(whole.replace(old, new))
        with pytest.raises(FormatError, match="its metadata are damaged"):
            built_in("dense", tmp_path / "damaged.onnx")


def test_a_box_far_larger_than_the_image_is_refused(
    demo: BopDataset, demo_boxes: Detections
) -> None:
    one = demo_boxes.select(np.array([0]))
    huge = replace(one, box_xywh=np.array([[-20000.0, -20000.0, 50000.0, 50000.0]]))
    key = int(one.scene_id[0]), int(one.im_id[0])
    with pytest.raises(InputError, match="times as large as the image"):
        built_in("dense").estimate(demo.image(*key), demo.camera_of(*key).K, huge)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (b'"dataset": "ycbv"', b'"dataset": 123456', "its dataset is 123456"),
        (b"\n\tgraspcast\x12", b"\n\tgraspcasT\x12", "lacks the metadata on objects"),
    ],
)
def test_networks_that_are_not_ours(tmp_path: Path, old: bytes, new: bytes, says: str) -> None:
    whole = (WEIGHTS / "dense.onnx").read_bytes()
    assert whole.count(old) == 1
    (tmp_path / "other.onnx").write_bytes(whole.replace(old, new))
    with pytest.raises(FormatError, match=says):
        built_in("dense", tmp_path / "other.onnx")


def test_a_network_with_other_inputs_does_not_run(
    tmp_path: Path, dense_inputs: tuple[np.ndarray, np.ndarray, Detections]
) -> None:
    whole = (WEIGHTS / "dense.onnx").read_bytes()
    (tmp_path / "other.onnx").write_bytes(whole.replace(b"\x05image", b"\x05photo"))
    estimator = built_in("dense", tmp_path / "other.onnx")
    image, K, seen = dense_inputs
    with pytest.raises(FormatError, match=r"other\.onnx: does not run"):
        estimator.estimate(image, K, seen)
