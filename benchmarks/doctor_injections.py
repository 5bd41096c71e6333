"""The faults that ``doctor_faults.py`` injects: each changes a dataset, with random draws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from numpy import ndarray

from doctor_files import ESTIMATORS, Files
from graspcast.bop.results import Results
from graspcast.pose.transforms import (
    invert,
    quaternion,
    rotation_from_quaternion,
    rotation_from_vector,
    rotation_vector,
    transform,
)

Inject = Callable[[Files, np.random.Generator], Any]


@dataclass(frozen=True)
class Fault:
    """A kind of fault, the base that it is injected into, and the code that names it."""

    name: str
    base: str
    code: str
    inject: Inject


FAULTS: list[Fault] = []


def fault(name: str, base: str, code: str) -> Callable[[Inject], Inject]:
    def add(inject: Inject) -> Inject:
        FAULTS.append(Fault(name, base, code, inject))
        return inject

    return add


def one(rng: np.random.Generator) -> str:
    return str(rng.choice(ESTIMATORS))


def posed(files: Files, name: str, change: Callable[[ndarray], ndarray]) -> None:
    table = files.results[name]
    files.results[name] = replace(table, cam_T_obj=change(table.cam_T_obj.copy()))


def scaled(factor: float) -> Callable[[ndarray], ndarray]:
    def change(poses: ndarray) -> ndarray:
        poses[:, :3, 3] *= factor
        return poses

    return change


def turned(turn: Callable[[ndarray], ndarray]) -> Callable[[ndarray], ndarray]:
    return lambda poses: transform(turn(poses[:, :3, :3]), poses[:, :3, 3])


for unit, factor in (("metres", 1e-3), ("centimetres", 0.1), ("inches", 1 / 25.4)):

    @fault(f"results in {unit}", "any", "results-unit")
    def _(files: Files, rng: np.random.Generator, factor: float = factor) -> None:
        posed(files, one(rng), scaled(factor))

    @fault(f"ground truth in {unit}", "any", "truth-unit")
    def _(files: Files, rng: np.random.Generator, factor: float = factor) -> None:
        for entry in entries(files, "scene_gt"):
            entry["cam_t_m2c"] = [factor * x for x in entry["cam_t_m2c"]]

    @fault(f"models_info.json in {unit}", "any", "models-unit")
    def _(files: Files, rng: np.random.Generator, factor: float = factor) -> None:
        scale_info(files, factor)

    @fault(f"a mesh in {unit}", "any", "mesh-unit")
    def _(files: Files, rng: np.random.Generator, factor: float = factor) -> None:
        obj_id = int(rng.choice(list(files.meshes)))
        files.vertices[obj_id] = (files.points(obj_id) * factor, False)


def entries(files: Files, name: str) -> list[dict[str, Any]]:
    return [e for s in files.scenes.values() for image in s[name].values() for e in image]


def cameras(files: Files) -> list[dict[str, Any]]:
    return [e for s in files.scenes.values() for e in s["scene_camera"].values()]


def scale_info(files: Files, factor: float) -> None:
    for entry in files.info.values():
        for key, value in entry.items():
            if not key.startswith("symmetries"):
                entry[key] = value * factor


@fault("models and meshes in centimetres", "boxes", "models-unit")
def _(files: Files, rng: np.random.Generator) -> None:
    scale_info(files, 0.1)
    for obj_id in files.meshes:
        files.vertices[obj_id] = (files.points(obj_id) * 0.1, False)


@fault("camera poses in metres", "ycbv", "camera-poses-unit")
def _(files: Files, rng: np.random.Generator) -> None:
    for entry in cameras(files):
        entry["cam_t_w2c"] = [x / 1000 for x in entry["cam_t_w2c"]]


@fault("camera poses inverted", "ycbv", "camera-poses-inverted")
def _(files: Files, rng: np.random.Generator) -> None:
    for entry in cameras(files):
        R = np.array(entry["cam_R_w2c"]).reshape(3, 3)
        entry["cam_t_w2c"] = (-R.T @ np.array(entry["cam_t_w2c"])).tolist()
        entry["cam_R_w2c"] = R.T.ravel().tolist()


@fault("camera poses with transposed rotations", "ycbv", "camera-poses-transposed")
def _(files: Files, rng: np.random.Generator) -> None:
    for entry in cameras(files):
        entry["cam_R_w2c"] = np.array(entry["cam_R_w2c"]).reshape(3, 3).T.ravel().tolist()


def set_camera(files: Files, change: Callable[[ndarray], ndarray]) -> None:
    for entry in cameras(files):
        entry["cam_K"] = change(np.array(entry["cam_K"]).reshape(3, 3)).ravel().tolist()
    c = files.camera
    K = change(np.array([[c["fx"], 0, c["cx"]], [0, c["fy"], c["cy"]], [0, 0, 1]]))
    if K[2, 2] == 1 and K[0, 2]:
        c |= {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}


@fault("intrinsics of another camera", "boxes", "camera-wrong")
def _(files: Files, rng: np.random.Generator) -> None:
    factor = rng.choice([1066.778 / 572.4114, 1.3, 0.75, 0.6])
    set_camera(files, lambda K: K * [[factor, 1, 1], [1, factor, 1], [1, 1, 1]])


@fault("intrinsics of another resolution", "boxes", "camera-other-size")
def _(files: Files, rng: np.random.Generator) -> None:
    factor = rng.choice([0.5, 2.0, 1.5, 0.75])
    set_camera(files, lambda K: K * [[factor] * 3, [factor] * 3, [1, 1, 1]])


@fault("intrinsics of an uncropped image", "boxes", "camera-wrong")
def _(files: Files, rng: np.random.Generator) -> None:
    x, y = rng.choice([-1, 1], 2) * rng.uniform(40, 120, 2)
    set_camera(files, lambda K: K + np.array([[0, 0, x], [0, 0, y], [0, 0, 0]]))


@fault("intrinsics transposed", "boxes", "camera-transposed")
def _(files: Files, rng: np.random.Generator) -> None:
    set_camera(files, lambda K: K.T)


def in_frame(D: ndarray, files: Files, names: tuple[str, ...]) -> dict[int, ndarray]:
    """Move estimates into a frame of the object, and return the repairs."""
    for name in names:
        posed(files, name, lambda poses: poses @ invert(D))
    return dict.fromkeys(files.meshes, D)


@fault("model centred by one estimator", "any", "other-model-frame")
def _(files: Files, rng: np.random.Generator) -> dict[int, ndarray]:
    """The origin in the middle of a side, on which the object stands; none is smaller than 6 %."""
    repairs, name = {}, one(rng)
    table = files.results[name]
    poses = table.cam_T_obj.copy()
    axis, side = int(rng.integers(3)), float(rng.choice([-0.5, 0.5]))
    for obj_id, entry in ((int(i), e) for i, e in files.info.items()):
        low = np.array([entry[f"min_{a}"] for a in "xyz"]) / 1000
        size = np.array([entry[f"size_{a}"] for a in "xyz"]) / 1000
        middle = low + size / 2
        middle[axis] += side * size[axis]
        D = transform(np.eye(3), -middle)
        mine = table.obj_id == obj_id
        poses[mine] = poses[mine] @ invert(D)
        repairs[obj_id] = D
    files.results[name] = replace(table, cam_T_obj=poses)
    return repairs


@fault("offset model frame of one estimator", "any", "other-model-frame")
def _(files: Files, rng: np.random.Generator) -> dict[int, ndarray]:
    shift = direction(rng) * rng.uniform(0.05, 0.15)
    return in_frame(transform(np.eye(3), shift), files, (one(rng),))


@fault("rotated model frame of one estimator", "any", "other-model-frame")
def _(files: Files, rng: np.random.Generator) -> dict[int, ndarray]:
    vector = np.eye(3)[rng.integers(3)] * np.pi / 2 * rng.choice([-1, 1])
    return in_frame(transform(rotation_from_vector(vector), np.zeros(3)), files, (one(rng),))


@fault("any other model frame of one estimator", "any", "other-model-frame")
def _(files: Files, rng: np.random.Generator) -> dict[int, ndarray]:
    R = rotation_from_vector(direction(rng) * rng.uniform(0.4, 2.0))
    return in_frame(transform(R, direction(rng) * rng.uniform(0.02, 0.1)), files, (one(rng),))


@fault("any other model frame of all estimators", "any", "other-model-frame")
def _(files: Files, rng: np.random.Generator) -> dict[int, ndarray]:
    R = rotation_from_vector(direction(rng) * rng.uniform(0.4, 2.0))
    return in_frame(transform(R, direction(rng) * rng.uniform(0.02, 0.1)), files, ESTIMATORS)


def direction(rng: np.random.Generator) -> ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


@fault("rotations transposed", "any", "poses-transposed")
def _(files: Files, rng: np.random.Generator) -> None:
    posed(files, one(rng), turned(lambda R: np.swapaxes(R, 1, 2)))


@fault("poses inverted", "any", "poses-inverted")
def _(files: Files, rng: np.random.Generator) -> None:
    posed(files, one(rng), invert)


for words, order in (("wxyz read as xyzw", (3, 0, 1, 2)), ("xyzw read as wxyz", (1, 2, 3, 0))):

    @fault(f"quaternions {words}", "any", "quaternion-order")
    def _(files: Files, rng: np.random.Generator, order: tuple[int, ...] = order) -> None:
        posed(
            files,
            one(rng),
            turned(lambda R: rotation_from_quaternion(quaternion(R)[:, list(order)])),
        )


@fault("OpenGL's camera axes", "any", "camera-axes")
def _(files: Files, rng: np.random.Generator) -> None:
    posed(files, one(rng), lambda poses: np.diag([1.0, -1.0, -1.0, 1.0]) @ poses)


@fault("PyTorch3D's camera axes", "any", "camera-axes")
def _(files: Files, rng: np.random.Generator) -> None:
    posed(files, one(rng), lambda poses: np.diag([-1.0, -1.0, 1.0, 1.0]) @ poses)


@fault("radians read as degrees", "any", "rotation-unit")
def _(files: Files, rng: np.random.Generator) -> None:
    posed(files, one(rng), turned(lambda R: rotation_from_vector(np.radians(rotation_vector(R)))))


@fault("mirrored rotations", "any", "poses-mirrored")
def _(files: Files, rng: np.random.Generator) -> None:
    sign = np.ones(3)
    sign[rng.integers(3)] = -1
    posed(files, one(rng), turned(lambda R: R * sign))


@fault("ground truth with transposed rotations", "any", "poses-transposed")
def _(files: Files, rng: np.random.Generator) -> None:
    for entry in entries(files, "scene_gt"):
        entry["cam_R_m2c"] = np.array(entry["cam_R_m2c"]).reshape(3, 3).T.ravel().tolist()


@fault("a mesh negated in one axis", "any", "mesh-mirrored")
def _(files: Files, rng: np.random.Generator) -> None:
    mirror(files, rng, faces=False)


@fault("a mesh mirrored with its faces", "boxes", "mesh-mirrored")
def _(files: Files, rng: np.random.Generator) -> None:
    mirror(files, rng, faces=True)


def mirror(files: Files, rng: np.random.Generator, *, faces: bool) -> None:
    obj_id, sign = int(rng.choice(list(files.meshes))), np.ones(3)
    sign[rng.integers(3)] = -1
    files.vertices[obj_id] = (files.points(obj_id) * sign, faces)
    entry, points = files.info[str(obj_id)], files.points(obj_id) * sign * 1000
    entry |= {f"min_{a}": float(x) for a, x in zip("xyz", points.min(axis=0), strict=True)}


@fault("missing symmetry of a symmetric object", "symmetric", "symmetry-unstated")
def _(files: Files, rng: np.random.Generator) -> None:
    """Symmetric objects as estimators see them: any of the equivalent poses, at random."""
    for entry in files.info.values():
        entry.pop("symmetries_discrete", None)
    if files.flipped is not None:
        name, table = files.flipped
        files.results[name] = table


@fault("a stated symmetry that the shape lacks", "any", "symmetry-contradicted")
def _(files: Files, rng: np.random.Generator) -> None:
    obj_id = str(rng.choice(list(files.info)))
    R = rotation_from_vector(np.eye(3)[rng.integers(3)] * np.pi / 2)
    files.info[obj_id]["symmetries_discrete"] = [transform(R, np.zeros(3)).ravel().tolist()]


@fault("a continuous symmetry that the shape lacks", "any", "symmetry-contradicted")
def _(files: Files, rng: np.random.Generator) -> None:
    obj_id = str(rng.choice(list(files.info)))
    axis = np.eye(3)[rng.integers(3)].tolist()
    files.info[obj_id]["symmetries_continuous"] = [{"axis": axis, "offset": [0, 0, 0]}]


@fault("estimates of another dataset", "other", "other-dataset")
def _(files: Files, rng: np.random.Generator) -> None:
    """One estimator's file is of the other dataset, and named as of this one."""
    assert files.other is not None
    files.results[one(rng)] = files.other


@fault("objects numbered from 1 in training order", "any", "objects-renumbered")
def _(files: Files, rng: np.random.Generator) -> None:
    name = one(rng)
    table = files.results[name]
    numbers = np.array(list(files.meshes))
    moved = np.roll(numbers, int(rng.integers(1, len(numbers))))
    new = moved[np.searchsorted(numbers, table.obj_id)]
    files.results[name] = replace(table, obj_id=new)


def boxed(files: Files, change: Callable[[ndarray], ndarray], *, truth: bool = False) -> None:
    for entry in entries(files, "scene_gt_info") if truth else files.detections:
        key = "bbox_obj" if truth else "bbox"
        entry[key] = change(np.array(entry[key], dtype=float)).tolist()


def corners(b: ndarray) -> ndarray:
    return np.array([b[0], b[1], b[0] + b[2], b[1] + b[3]])


@fault("annotated boxes as corners", "boxes", "boxes-corners")
def _(files: Files, rng: np.random.Generator) -> None:
    boxed(files, corners, truth=True)


@fault("detections as corners", "demo", "boxes-corners")
def _(files: Files, rng: np.random.Generator) -> None:
    boxed(files, corners)


@fault("detections as shares of the image", "demo", "boxes-shares")
def _(files: Files, rng: np.random.Generator) -> None:
    boxed(files, lambda b: b / [640, 480, 640, 480])


@fault("detections as centre and size", "demo", "boxes-centre")
def _(files: Files, rng: np.random.Generator) -> None:
    boxed(files, lambda b: np.array([b[0] + b[2] / 2, b[1] + b[3] / 2, b[2], b[3]]))


@fault("detections with y before x", "demo", "boxes-swapped")
def _(files: Files, rng: np.random.Generator) -> None:
    boxed(files, lambda b: b[[1, 0, 3, 2]])


@fault("detections in images of another size", "demo", "boxes-other-size")
def _(files: Files, rng: np.random.Generator) -> None:
    factor = rng.choice([0.5, 0.625, 0.75, 0.4])
    boxed(files, lambda b: b * factor)


@fault("an estimator under two names", "any", "estimator-copied")
def _(files: Files, rng: np.random.Generator) -> None:
    a, b = rng.permutation(ESTIMATORS)[:2]
    table = files.results[a]
    files.results[b] = replace(table, cam_T_obj=np.round(table.cam_T_obj, 6))


@fault("an estimator that refines another", "any", "estimator-refines")
def _(files: Files, rng: np.random.Generator) -> None:
    """Errors are shortened to 30 to 80 %, with noise of a tenth of their size."""
    a, b = rng.permutation(ESTIMATORS)[:2]
    table = files.results[a]
    files.results[b] = replace(table, cam_T_obj=refined(files, table, rng))


def refined(files: Files, table: Results, rng: np.random.Generator) -> ndarray:
    truth = true_poses(files)
    out = table.cam_T_obj.copy()
    keys = zip(table.scene_id.tolist(), table.im_id.tolist(), table.obj_id.tolist(), strict=True)
    share = rng.uniform(0.3, 0.8)
    for i, key in enumerate(keys):
        if key not in truth:
            continue
        error = invert(truth[key]) @ out[i]
        kept = np.clip(share + rng.normal(0, 0.1), 0, 1)
        vector = kept * rotation_vector(error[:3, :3])
        shift = kept * error[:3, 3] * rng.normal(1, 0.1, 3)
        vector = vector * rng.normal(1, 0.1, 3)
        out[i] = truth[key] @ transform(rotation_from_vector(vector), shift)
    return out


def true_poses(files: Files) -> dict[tuple[int, int, int], ndarray]:
    return {
        (scene_id, int(im_id), entry["obj_id"]): transform(
            np.array(entry["cam_R_m2c"]).reshape(3, 3), np.array(entry["cam_t_m2c"]) / 1000
        )
        for scene_id, s in files.scenes.items()
        for im_id, image in s["scene_gt"].items()
        for entry in image
    }


@fault("ground truth as an estimator", "any", "estimator-is-truth")
def _(files: Files, rng: np.random.Generator) -> None:
    name, truth = one(rng), true_poses(files)
    table = files.results[name]
    keys = zip(table.scene_id.tolist(), table.im_id.tolist(), table.obj_id.tolist(), strict=True)
    poses = [truth.get(key, table.cam_T_obj[i]) for i, key in enumerate(keys)]
    files.results[name] = replace(table, cam_T_obj=np.array(poses))


@fault("images that come twice", "demo", "duplicate-images")
def _(files: Files, rng: np.random.Generator) -> None:
    keys = list(files.images)
    for _ in range(int(rng.integers(1, 5))):
        a, b = rng.permutation(len(keys))[:2]
        files.images[keys[a]] = files.images[keys[b]]


@fault("poses of images that come twice", "any", "poses-repeated")
def _(files: Files, rng: np.random.Generator) -> None:
    """The estimates of a scene's first images stand under the numbers of its last ones too."""
    for name, table in files.results.items():
        poses = table.cam_T_obj.copy()
        images = [
            ((scene, a), (scene, b))
            for scene in np.unique(table.scene_id).tolist()
            for of in [np.unique(table.im_id[table.scene_id == scene]).tolist()]
            for a, b in zip(of[: len(of) // 3], of[::-1], strict=False)
        ]
        for (s, i), (z, j) in images:
            rows = np.flatnonzero((table.scene_id == s) & (table.im_id == i))
            others = np.flatnonzero((table.scene_id == z) & (table.im_id == j))
            for row in others:
                same = rows[table.obj_id[rows] == table.obj_id[row]]
                if len(same):
                    poses[row] = poses[same[0]]
        files.results[name] = replace(table, cam_T_obj=poses)


@fault("outcome tables that contradict each other", "any", "outcomes-contradict")
def _(files: Files, rng: np.random.Generator) -> None:
    table = files.outcomes["trials"]
    other = table.sample(fraction=0.5, seed=int(rng.integers(1000)))
    wrong = pl.Series(rng.random(len(other)) < 0.2)
    files.outcomes["again"] = other.with_columns(
        success=pl.when(wrong).then(1 - pl.col("success")).otherwise(pl.col("success"))
    )


@fault("trials with both outcomes", "any", "outcomes-contradict")
def _(files: Files, rng: np.random.Generator) -> None:
    table = files.outcomes["trials"]
    again = table.sample(5, seed=int(rng.integers(1000))).with_columns(
        success=1 - pl.col("success")
    )
    files.outcomes["trials"] = pl.concat([table, again])


@fault("outcomes of other images", "any", "outcomes-unmatched")
def _(files: Files, rng: np.random.Generator) -> None:
    table = files.outcomes["trials"]
    files.outcomes["trials"] = table.with_columns(im_id=pl.col("im_id") + 10000)


@fault("outcomes that are all alike", "any", "outcomes-constant")
def _(files: Files, rng: np.random.Generator) -> None:
    value = int(rng.integers(2))
    files.outcomes["trials"] = files.outcomes["trials"].with_columns(success=pl.lit(value))


@fault("images in training and calibration", "any", "shared-images")
def _(files: Files, rng: np.random.Generator) -> None:
    table = files.outcomes["trials"]
    files.calibration = table.sample(fraction=0.3, seed=int(rng.integers(1000)))


@fault("scenes in training and calibration", "any", "shared-scenes")
def _(files: Files, rng: np.random.Generator) -> None:
    table = files.outcomes["trials"]
    images = table["im_id"].unique().sort()
    half = images.sample(fraction=0.5, seed=int(rng.integers(1000))).to_list()
    files.outcomes["trials"] = table.filter(~pl.col("im_id").is_in(half))
    files.calibration = table.filter(pl.col("im_id").is_in(half))


@fault("scores that are all zero", "any", "scores-constant")
def _(files: Files, rng: np.random.Generator) -> None:
    name = str(rng.choice(["gdrnpp", "zebrapose"]))
    table = files.results[name]
    files.results[name] = replace(table, score=np.zeros(len(table)))


@fault("images of another size", "demo", "image-size")
def _(files: Files, rng: np.random.Generator) -> None:
    width, height = [(1280, 960), (320, 240), (800, 600)][int(rng.integers(3))]
    files.camera |= {"width": width, "height": height}
