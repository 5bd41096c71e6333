"""Conversion of the paper authors' release to BOP files.

A checkout of their repository holds, for each estimator, dataset and object, the estimated and true
poses (``pose_data_*.npz``, metres), an index of them (``*.txt``), and trial outcomes by one-based
row number; and the 80-20 split of each principal, object and gripper. A true pose is given only
together with an estimate. Of the few instances that no estimator found only the visibility is
known: they are among the targets, but not in ``scene_gt.json``. Where scenes are static, true poses
also give the camera's motion.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from operator import itemgetter
from os import PathLike
from pathlib import Path

import numpy as np
import polars as pl
from numpy import ndarray

from graspcast.bop.results import Results, write_results
from graspcast.bop.units import millimetres
from graspcast.errors import FormatError, InputError
from graspcast.io.arrays import read_arrays
from graspcast.io.json import write_json
from graspcast.io.reading import read_text
from graspcast.io.tables import write_table
from graspcast.paper.annotated_motion import camera_track
from graspcast.pose.transforms import invert

__all__ = ["Imported", "import_release", "read_add_differences", "read_release"]

_REMEDY = "download it again"

_DATASETS = {"LMO": "lmo", "YCBV": "ycbv"}
_GRIPPERS = {"Parallel-Gripper": "parallel", "Underactuated-Gripper": "underactuated"}
_SPLIT = re.compile(r"(train|test)-(\w+?)-(LMO|YCBV)(\d+)-(Parallel|Underactuated)-t3r3")
_NO_GRASP = ("lmo", 10, "parallel")
"""The egg carton is too wide for the parallel gripper; its file holds zeros instead of trials."""

Key = tuple[int, int, int]  # scene, image, object


@dataclass
class _Instance:
    """A ground-truth instance; its pose is None if no estimator found it."""

    cam_T_gt: ndarray | None
    visib_fract: float
    bbox: list[float]


@dataclass
class _Dataset:
    truth: dict[Key, _Instance] = field(default_factory=dict)
    estimates: dict[str, dict[Key, tuple[ndarray, float]]] = field(default_factory=dict)
    trials: list[tuple[str, Key, str, int]] = field(default_factory=list)
    split: list[tuple[str, str, Key, str]] = field(default_factory=list)


@dataclass(frozen=True)
class Imported:
    """Counts of what was written for one dataset.

    Attributes
    ----------
    dataset
        The dataset's name.
    estimates
        Number of poses by estimator.
    trials
        Number of trial outcomes.
    instances
        Number of ground-truth instances.
    unseen
        How many of them no estimator found; the release has no pose for them.
    """

    dataset: str
    estimates: dict[str, int]
    trials: int
    instances: int
    unseen: int


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield number and tab-separated fields of each line that is not a comment."""
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if line.strip() and not line.startswith("#"):
            yield number, line.split("\t")


def _parse(path: Path, number: int, fields: list[str], *kinds: type) -> list[int | float | str]:
    try:
        return [kind(text) for kind, text in zip(kinds, fields, strict=True)]
    except ValueError as error:
        raise FormatError(path, f"unexpected fields {fields}", where=f"line {number}") from error


def _poses(path: Path) -> tuple[ndarray, ndarray]:
    arrays = read_arrays(path, _REMEDY, digest=False)
    try:
        est, gt = arrays["T_est"], arrays["T_gt"]
    except KeyError as error:
        raise FormatError(path, "holds no arrays T_est and T_gt") from error
    if est.shape != gt.shape or est.ndim != 3 or est.shape[1:] != (4, 4):
        raise FormatError(path, f"T_est {est.shape} and T_gt {gt.shape} should be (n, 4, 4)")
    return est, gt


def _read_poses(index: Path, name: str, dataset: str, obj_id: int, out: _Dataset) -> list[Key]:
    """Add one object's estimates; return the key of each row of the npz file."""
    est, gt = _poses(index.with_name(f"pose_data_{index.stem}.npz"))
    keys: dict[int, Key] = {}
    for number, fields in _lines(index):
        if len(fields) != 10:
            raise FormatError(index, "should have ten fields", where=f"line {number}")
        if fields[3] == "FP":
            continue
        scene, image, visible = _parse(index, number, [*fields[:2], fields[4]], int, int, float)
        key = (int(scene), int(image), obj_id)
        box = fields[8].split(",")
        bbox = [float(v) for v in _parse(index, number, box, *[float] * len(box))]
        instance = out.truth.setdefault(key, _Instance(None, float(visible), bbox))
        if fields[3] != "TP":
            continue
        row, score = _parse(index, number, [fields[2], fields[5]], int, float)
        if not 0 <= int(row) < len(est):
            raise FormatError(index, f"names row {row} of {len(est)}", where=f"line {number}")
        keys[int(row)] = key
        if instance.cam_T_gt is None:
            instance.cam_T_gt = gt[int(row)]
        out.estimates.setdefault(name, {})[key] = (est[int(row)], float(score))
    if len(keys) != len(est):
        raise FormatError(index, f"names {len(keys)} of the {len(est)} poses of its npz file")
    return [keys[row] for row in range(len(est))]


def _read_trials(path: Path, name: str, gripper: str, keys: list[Key], out: _Dataset) -> None:
    for number, fields in _lines(path):
        position, success = _parse(path, number, fields, int, int)
        if not 1 <= int(position) <= len(keys) or success not in (0, 1):
            raise FormatError(
                path, f"position {position}, outcome {success}", where=f"line {number}"
            )
        out.trials.append((name, keys[int(position) - 1], gripper, int(success)))


def _read_split(folder: Path, out: dict[str, _Dataset]) -> None:
    for path in sorted(folder.glob("t*-*-*-*-t3r3.txt")):
        match = _SPLIT.fullmatch(path.stem)
        if match is None:
            raise FormatError(path, "is not named as a split file (train-EPOS-LMO1-Parallel-t3r3)")
        part, principal, dataset, _, gripper = match.groups()
        for number, fields in _lines(path):
            scene, image, obj_id = _parse(path, number, fields[1:4], int, int, int)
            key = (int(scene), int(image), int(obj_id))
            out[_DATASETS[dataset]].split.append((principal.lower(), gripper.lower(), key, part))


def _has_trials(release: Path, folder: Path) -> bool:
    """Whether trials were guided by the estimates of a folder.

    The repository also holds estimates of the same estimators with other weights, in folders beside
    it, which no trial used.
    """
    return any((release / gripper / folder).is_dir() for gripper in _GRIPPERS)


def read_release(release: str | PathLike[str]) -> dict[str, _Dataset]:
    """Read a checkout of the authors' repository.

    Raises
    ------
    InputError
        If it is something else.
    FormatError
        Naming the bad file and line.
    """
    release = Path(release)
    estimates = release / "Pose-Estimates"
    if not estimates.is_dir():
        raise InputError(
            f"{release}: no folder Pose-Estimates; is it a checkout of the authors' repository?",
            parameters=("release",),
        )
    out = {name: _Dataset() for name in _DATASETS.values()}
    for index in sorted(estimates.glob("*/*/**/*.txt")):
        if not _has_trials(release, index.parent.relative_to(estimates)):
            continue
        match = re.fullmatch(r"(lmo|ycbv)-(\d+)-(\w+)", index.stem)
        if match is None:
            raise FormatError(index, "is not named as an index (lmo-1-epos.txt)")
        dataset, obj_id, name = match[1], int(match[2]), match[3]
        keys = _read_poses(index, name, dataset, obj_id, out[dataset])
        for folder, gripper in _GRIPPERS.items():
            relative = index.relative_to(estimates).with_name(f"{index.stem}-{gripper}-results.txt")
            trials = release / folder / relative
            if trials.is_file() and (dataset, obj_id, gripper) != _NO_GRASP:
                _read_trials(trials, name, gripper, keys, out[dataset])
    _read_split(release / "Train-Grasp-Success-Prediction" / "Data-Split" / "t3r3", out)
    return out


def read_add_differences(
    release: str | PathLike[str],
) -> dict[tuple[str, str, int, int, int], float]:
    """Read the mean ADD to the supporters, metres, by (principal, dataset, scene, image, object).

    Raises
    ------
    FormatError
        Naming the bad file and line.
    """
    folder = Path(release) / "Train-Grasp-Success-Prediction" / "Data-Split" / "add"
    out = {}
    for path in sorted(folder.glob("dataset-*-add.txt")):
        principal = path.stem.split("-")[1].lower()
        arrays = read_arrays(path.with_suffix(".npz"), _REMEDY, digest=False)
        if "arr_0" not in arrays:
            raise FormatError(path.with_suffix(".npz"), "holds no array arr_0")
        add = arrays["arr_0"]
        for number, fields in _lines(path):
            kinds = (str, int, int, int, float, int, int, int, int)
            dataset, scene, image, obj_id, _, *pair, _, _ = _parse(path, number, fields, *kinds)
            key = (principal, _DATASETS[str(dataset)], int(scene), int(image), int(obj_id))
            out[key] = float(np.mean(add[pair]))
    return out


def import_release(release: str | PathLike[str], out: str | PathLike[str]) -> list[Imported]:
    """Convert a checkout of the authors' repository to BOP files, one directory per dataset.

    Poses read from these files are exactly those of the release.

    Parameters
    ----------
    release
        The checkout.
    out
        The directory in which ``lmo`` and ``ycbv`` are created.

    Returns
    -------
    Counts of what was written, by dataset.

    Raises
    ------
    InputError
        If ``release`` is not a checkout, or ``out`` cannot be written.
    FormatError
        Naming the bad file and line.
    """
    return [_write(Path(out), name, data) for name, data in read_release(release).items()]


def _write(out: Path, name: str, data: _Dataset) -> Imported:
    folder = out / name
    for estimator, rows in sorted(data.estimates.items()):
        write_results(folder / f"{estimator}_{name}-test.csv", _results(rows))
    columns = ("scene_id", "im_id", "obj_id")
    trials = pl.DataFrame(
        [
            (estimator, name, *key, gripper, success)
            for estimator, key, gripper, success in sorted(data.trials, key=itemgetter(0, 2))
        ],
        schema=["estimator", "dataset", *columns, "gripper", "success"],
        orient="row",
    )
    write_table(folder / "trials.csv", trials)
    write_table(folder / "trials.parquet", trials)
    split = pl.DataFrame(
        [(principal, gripper, name, *key, part) for principal, gripper, key, part in data.split],
        schema=["principal", "gripper", "dataset", *columns, "split"],
        orient="row",
    )
    write_table(folder / "split.csv", split)
    truth = dict(sorted(data.truth.items()))
    visibility = pl.DataFrame(
        [(*key, instance.visib_fract) for key, instance in truth.items()],
        schema=[*columns, "visib_fract"],
        orient="row",
    )
    write_table(folder / "visibility.csv", visibility)
    targets = [{"im_id": i, "inst_count": 1, "obj_id": o, "scene_id": s} for s, i, o in truth]
    write_json(folder / "targets_all_gt.json", targets, one_entry_a_line=True)
    _write_ground_truth(folder / "ground_truth", truth)
    _write_camera_motion(folder / "camera_motion", truth)
    counts = {e: len(rows) for e, rows in sorted(data.estimates.items())}
    unseen = sum(instance.cam_T_gt is None for instance in truth.values())
    return Imported(name, counts, len(data.trials), len(truth), unseen)


def _results(rows: dict[Key, tuple[ndarray, float]]) -> Results:
    keys = np.array(sorted(rows), dtype=np.int64)
    picked = [rows[key] for key in sorted(rows)]
    return Results(
        scene_id=keys[:, 0],
        im_id=keys[:, 1],
        obj_id=keys[:, 2],
        score=np.array([score for _, score in picked]),
        cam_T_obj=np.stack([pose for pose, _ in picked]),
        time_s=np.full(len(picked), -1.0),
        line=np.zeros(len(picked), dtype=np.int64),
    )


def _write_ground_truth(folder: Path, truth: dict[Key, _Instance]) -> None:
    poses: dict[int, dict[str, list[dict[str, object]]]] = {}
    info: dict[int, dict[str, list[dict[str, object]]]] = {}
    for (scene, image, obj_id), instance in truth.items():
        if instance.cam_T_gt is None:
            continue
        entry = {
            "cam_R_m2c": instance.cam_T_gt[:3, :3].ravel().tolist(),
            "cam_t_m2c": millimetres(instance.cam_T_gt[:3, 3]).tolist(),
            "obj_id": obj_id,
        }
        poses.setdefault(scene, {}).setdefault(str(image), []).append(entry)
        seen = {"visib_fract": instance.visib_fract, "bbox_obj_xyxy": instance.bbox}
        info.setdefault(scene, {}).setdefault(str(image), []).append(seen)
    for scene in poses:
        scene_folder = folder / f"{scene:06d}"
        write_json(scene_folder / "scene_gt.json", poses[scene], one_entry_a_line=True)
        write_json(scene_folder / "scene_gt_info.json", info[scene], one_entry_a_line=True)


def _write_camera_motion(folder: Path, truth: dict[Key, _Instance]) -> None:
    """Write ``scene_camera.json`` of all scenes, if all of them are static."""
    scenes: dict[int, dict[int, dict[int, ndarray]]] = {}
    for (scene, image, obj_id), instance in truth.items():
        if instance.cam_T_gt is not None:
            scenes.setdefault(scene, {}).setdefault(image, {})[obj_id] = instance.cam_T_gt
    tracks = {scene: camera_track(images) for scene, images in scenes.items()}
    for scene, track in tracks.items():
        if track is None or None in tracks.values():
            continue
        cameras = {str(image): invert(world_T_cam) for image, world_T_cam in track.items()}
        entries = {
            image: {
                "cam_R_w2c": cam_T_world[:3, :3].ravel().tolist(),
                "cam_t_w2c": millimetres(cam_T_world[:3, 3]).tolist(),
            }
            for image, cam_T_world in cameras.items()
        }
        write_json(folder / f"{scene:06d}" / "scene_camera.json", entries, one_entry_a_line=True)
