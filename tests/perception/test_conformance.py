"""``check_estimator`` passes conforming estimators and names the faults of others."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bop_images import write_dataset
from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections, jittered
from graspcast.errors import InputError, UnknownNameError
from graspcast.perception.conformance import check_estimator
from graspcast.perception.estimator import Poses

DIAMETER_M = 0.12


class Sizes:
    """As far away as its box is small; turned by the colour of its box's middle."""

    name = "sizes"
    obj_ids: tuple[int, ...] = (1, 5)

    def estimate(self, image: np.ndarray, K: np.ndarray, detections: Detections) -> Poses:
        poses = np.tile(np.eye(4), (len(detections), 1, 1))
        for k, (obj_id, box) in enumerate(
            zip(detections.obj_id.tolist(), detections.box_xywh, strict=True)
        ):
            if obj_id not in self.obj_ids:
                raise UnknownNameError("object", obj_id, self.obj_ids)
            z = K[0, 0] * DIAMETER_M / box[2:].max()
            u, v = np.clip((box[:2] + box[2:] / 2).astype(int), 0, [95, 63])
            angle = image[v, u, 0] / 255
            cosine, sine = np.cos(angle), np.sin(angle)
            poses[k, :2, :2] = [[cosine, -sine], [sine, cosine]]
            poses[k, :3, 3] = z * np.linalg.inv(K) @ [*(box[:2] + box[2:] / 2), 1]
        return Poses(poses, np.full(len(detections), 0.5))


@pytest.fixture
def dataset(tmp_path: Path) -> BopDataset:
    return write_dataset(tmp_path / "made")


def test_a_conforming_estimator_passes(dataset: BopDataset) -> None:
    report = check_estimator(Sizes(), dataset, jittered(dataset, 0))
    assert report.passed, str(report)
    assert str(report).startswith("estimator sizes: passed")
    assert "ms for an image with 2 detections" in str(report)


def changed(change: Callable[[Poses], Poses]) -> type[Sizes]:
    class Changed(Sizes):
        def estimate(self, image: np.ndarray, K: np.ndarray, detections: Detections) -> Poses:
            return change(super().estimate(image, K, detections))

    return Changed


def scaled(factor: float) -> Callable[[Poses], Poses]:
    def change(poses: Poses) -> Poses:
        out = poses.cam_T_obj.copy()
        out[:, :3, 3] *= factor
        return Poses(out, poses.score)

    return change


def mirrored(poses: Poses) -> Poses:
    return Poses(poses.cam_T_obj @ np.diag([1.0, 1.0, -1.0, 1.0]), poses.score)


def opengl(poses: Poses) -> Poses:
    return Poses(np.diag([1.0, -1.0, -1.0, 1.0]) @ poses.cam_T_obj, poses.score)


def doubled(poses: Poses) -> Poses:
    return Poses(poses.cam_T_obj @ np.diag([2.0, 2.0, 2.0, 1.0]), poses.score)


def not_a_number(poses: Poses) -> Poses:
    return Poses(np.where(np.eye(4) == 0, np.nan, poses.cam_T_obj), poses.score)


def inverted(poses: Poses) -> Poses:
    return Poses(np.linalg.inv(poses.cam_T_obj), poses.score)


def elsewhere(poses: Poses) -> Poses:
    out = poses.cam_T_obj.copy()
    out[:, 0, 3] += 0.5 * out[:, 2, 3]
    return Poses(out, poses.score)


def upside_down(poses: Poses) -> Poses:
    return Poses(np.diag([-1.0, -1.0, 1.0, 1.0]) @ poses.cam_T_obj, poses.score)


def noisy() -> Callable[[Poses], Poses]:
    rng = np.random.default_rng(0)
    return lambda poses: Poses(poses.cam_T_obj, rng.random(len(poses)))


def best_first(poses: Poses) -> Poses:
    return Poses(poses.cam_T_obj[np.argsort(poses.cam_T_obj[:, 2, 3])], poses.score)


def infinite(poses: Poses) -> Poses:
    return Poses(poses.cam_T_obj, poses.score * np.inf)


def nothing(poses: Poses) -> Poses:
    return Poses(np.tile(np.eye(4), (len(poses), 1, 1)), 0 * poses.score)


def one_less(poses: Poses) -> Poses:
    return Poses(poses.cam_T_obj[1:], poses.score[1:])


class IgnoresImage(Sizes):
    def estimate(self, image: np.ndarray, K: np.ndarray, detections: Detections) -> Poses:
        return super().estimate(np.zeros_like(image), K, detections)


class OwnCamera(Sizes):
    def estimate(self, image: np.ndarray, K: np.ndarray, detections: Detections) -> Poses:
        own = np.array([[120.0, 0, 48], [0, 120, 32], [0, 0, 1]])
        return super().estimate(image, own, detections)


class ModifiesInput(Sizes):
    def estimate(self, image: np.ndarray, K: np.ndarray, detections: Detections) -> Poses:
        poses = super().estimate(image, K, detections)
        detections.box_xywh[:, 2:] += 4
        return poses


class AcceptsAnyObject(Sizes):
    def estimate(self, image: np.ndarray, K: np.ndarray, detections: Detections) -> Poses:
        known = replace(detections, obj_id=np.full(len(detections), 1))
        return super().estimate(image, K, known)


class RaisesKeyError(Sizes):
    def estimate(self, image: np.ndarray, K: np.ndarray, detections: Detections) -> Poses:
        table = {1: 0, 5: 1}
        for obj_id in detections.obj_id.tolist():
            table[obj_id]
        return super().estimate(image, K, detections)


class Raises(Sizes):
    def estimate(self, image: np.ndarray, K: np.ndarray, detections: Detections) -> Poses:
        raise ValueError("boom")


class HighScores(Sizes):
    def estimate(self, image: np.ndarray, K: np.ndarray, detections: Detections) -> Poses:
        found = super().estimate(image, K, detections)
        return Poses(found.cam_T_obj, found.score + 7.0)


class Nameless:
    obj_ids = (1, 5)

    def estimate(self, image: np.ndarray, K: np.ndarray, detections: Detections) -> Poses:
        raise AssertionError("is not to be asked")


@pytest.mark.parametrize(
    ("kind", "check", "words"),
    [
        pytest.param(Nameless, "attributes", "lacks name", marks=pytest.mark.ill_typed),
        (changed(one_less), "output", "expected"),
        (changed(nothing), "output", "found nothing"),
        (Raises, "output", "raised ValueError: boom"),
        (HighScores, "rigid", "expected 0 to 1"),
        (changed(infinite), "rigid", "not finite"),
        (changed(mirrored), "rigid", "has a mirrored rotation (determinant below 0)"),
        (changed(doubled), "rigid", "has a rotation scaled by 2"),
        (changed(not_a_number), "rigid", "holds numbers that are not finite"),
        (changed(opengl), "rigid", "behind the camera"),
        (changed(opengl), "rigid", "OpenGL's camera frame"),
        (changed(scaled(1000.0)), "rigid", "is it in millimetres"),
        (changed(scaled(100.0)), "rigid", "is it in millimetres"),
        (changed(scaled(0.001)), "rigid", "is it in metres"),
        (changed(inverted), "position|rigid", "obj_T_cam"),
        (changed(upside_down), "position", "PyTorch3D's camera frame"),
        (changed(elsewhere), "position", "is it cam_T_obj"),
        (changed(noisy()), "deterministic", "seed its"),
        (changed(best_first), "order", "in their order"),
        (ModifiesInput, "inputs_unchanged", "modified the detections"),
        (IgnoresImage, "uses_image", "is the image used"),
        (OwnCamera, "uses_camera", "expected about 1.5 times"),
        (AcceptsAnyObject, "unknown_object", "returned poses of object 6"),
        (RaisesKeyError, "unknown_object", "KeyError: 6"),
    ],
)
def test_each_fault_is_found_by_its_check(
    kind: type, check: str, words: str, dataset: BopDataset
) -> None:
    report = check_estimator(kind(), dataset, jittered(dataset, 0))
    failures = {c.name: c.detail for c in report.failures}
    said = [failures[name] for name in check.split("|") if name in failures]
    assert said and words in said[0], str(report)
    assert "FAILED" in str(report)


def test_detections_must_be_of_known_objects(dataset: BopDataset) -> None:
    unknowing = Sizes()
    unknowing.obj_ids = (77,)
    with pytest.raises(InputError, match=r"no detection of an object that sizes knows \(77\)"):
        check_estimator(unknowing, dataset, jittered(dataset, 0))


class Nameless(Sizes):
    name = ""


class KnowsNothing(Sizes):
    obj_ids = ()


class MakesUp(Sizes):
    def estimate(self, image: np.ndarray, K: np.ndarray, detections: Detections) -> Poses:
        if not len(detections):
            return Poses(np.eye(4)[None], np.ones(1))
        return super().estimate(image, K, detections)


@pytest.mark.parametrize(
    ("estimator", "says"),
    [
        (Nameless, "its name is ''; it should be text"),
        (KnowsNothing, r"obj_ids is \(\); it should hold BOP ids of objects"),
        (MakesUp, r"without detections it returned \(1, 4, 4\), not \(0, 4, 4\)"),
    ],
)
def test_names_objects_and_images_without_detections(
    dataset: BopDataset, estimator: type[Sizes], says: str
) -> None:
    report = check_estimator(estimator(), dataset, jittered(dataset, 0))
    assert not report.passed
    assert re.search(says, str(report))
