"""Running an estimator on a dataset: from images and detections to a results CSV."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections, write_detections
from graspcast.bop.results import Results, read_results, write_results
from graspcast.errors import EstimatorFailedError, FormatError, InputError, UnknownNameError
from graspcast.io.files import temporary_directory
from graspcast.io.progress import Count
from graspcast.perception.estimator import Estimator
from graspcast.perception.external import command_line, run_command
from graspcast.perception.network import CropEstimator
from graspcast.pose.sanity import is_placeholder

__all__ = ["estimate_poses", "run_estimator", "run_external"]

_log = logging.getLogger(__name__)


def run_estimator(
    estimator: Estimator,
    dataset: BopDataset,
    detections: Detections,
    out: str | PathLike[str],
    *,
    lenient: bool = False,
    progress: Callable[[float, str], None] | None = None,
) -> Results:
    """Run an estimator on every image with detections, and write a BOP results CSV.

    The time column holds the seconds that :meth:`Estimator.estimate` took for the image, without
    the detector's. Detections for which nothing is found have no row.

    Parameters
    ----------
    estimator
        Any estimator.
    dataset
        The dataset of the images.
    detections
        The detected objects.
    out
        The results file; it is written atomically.
    lenient
        Skip detections of objects that the estimator does not know, and count them.
    progress
        Called with the share of images done, from 0 to 1, and the next image.

    Returns
    -------
    The results written to ``out``.

    Raises
    ------
    UnknownNameError
        For a detected object that the estimator does not know.
    MismatchError
        If the estimator was trained for an object of another size or frame with the same number.
    InputError
        If an image cannot be read, or ``out`` cannot be written.
    FormatError
        If the estimator returns something other than poses.
    """
    trained = estimator.network.trained if isinstance(estimator, CropEstimator) else None
    if trained is not None:
        trained.check(dataset, set(detections.obj_id.tolist()))
        if trained.dataset not in (None, dataset.name):
            _log.warning(
                "%s was trained for objects of %s; those of %s have the same numbers, sizes and "
                "frames, and are taken for the same",
                trained.source,
                trained.dataset,
                dataset.name,
            )
        if trained.dataset is None:
            _log.warning(
                "%s does not say which dataset it was trained for: of its objects only sizes and "
                "frames were compared with those of %s",
                trained.source,
                dataset.name,
            )
    known = np.isin(detections.obj_id, estimator.obj_ids)
    if not known.all() and not lenient:
        raise UnknownNameError(
            "object",
            detections.obj_id[~known][0],
            sorted(estimator.obj_ids),
            hint=f"{estimator.name} was trained for these; {detections.source} has others too",
            parameters=("lenient",),
        )
    with _temporary(Path(out)) as written:
        found = estimate_poses(estimator, dataset, detections.select(known), progress)
        write_results(written, found)
        results = _accept(written, Path(out), dataset, detections)
    return _counted(results, {"object that the estimator does not know": ~known})


def estimate_poses(
    estimator: Estimator,
    dataset: BopDataset,
    detections: Detections,
    progress: Callable[[float, str], None] | None = None,
) -> Results:
    """Run an estimator on every image with detections; drop placeholders.

    Nothing is written or checked; :func:`run_estimator` does that.

    Raises
    ------
    InputError
        If there is no detection, or an image cannot be read.
    UnknownNameError
        For a detected object that the estimator does not know.
    """
    images = detections.images()
    if not images:
        raise InputError(f"{detections.source}: no detection that {estimator.name} could use")
    parts = []
    for i, (key, seen) in enumerate(images.items()):
        if progress:
            progress(i / len(images), Count(i, len(images), "images"))
        image, camera = dataset.image(*key), dataset.camera_of(*key)
        start = time.perf_counter()
        poses = estimator.estimate(image, camera.K, seen)
        took = time.perf_counter() - start
        found = ~is_placeholder(poses.cam_T_obj)
        rows = (seen.scene_id[found], seen.im_id[found], seen.obj_id[found])
        seconds = np.full(len(rows[0]), took)
        parts.append((*rows, poses.score[found], poses.cam_T_obj[found], seconds))
    scene_id, im_id, obj_id, score, cam_T_obj, time_s = map(
        np.concatenate, zip(*parts, strict=True)
    )
    line = np.zeros(len(obj_id), dtype=np.int64)
    return Results(scene_id, im_id, obj_id, score, cam_T_obj, time_s, line)


def run_external(
    template: str,
    dataset: BopDataset,
    detections: Detections,
    out: str | PathLike[str],
    *,
    timeout_s: float | None = None,
    lenient: bool = False,
    progress: Callable[[float, str], None] | None = None,
) -> Results:
    """Run an external estimator, a command, and write its poses as a BOP results CSV.

    The command writes to a temporary directory beside ``out``. Its file is checked as any results
    CSV, and against the dataset, before it is written to ``out``; the poses are not changed.

    Parameters
    ----------
    template
        The command, with ``{out}`` and, where it needs them, ``{bop}`` and ``{detections}``, filled
        in as absolute paths; see :func:`graspcast.perception.external.command_line`. If it uses
        ``{detections}``, poses in images without detections are refused. These are given as they
        are in their file, or, if it holds others too or has another form than the BOP Challenge's,
        in a file that is written for it.
    dataset
        The dataset of the images.
    detections
        The detected objects, as read from a file.
    out
        The results file; it is written atomically.
    timeout_s
        Stop the command after this time, seconds.
    lenient
        Skip bad rows, and count them.
    progress
        Called with each line that the command prints; the share done is unknown, and always 0.

    Returns
    -------
    The results written to ``out``.

    Raises
    ------
    InputError
        If the template is not a command, or ``out`` cannot be written.
    EstimatorFailedError
        If the command cannot be started, fails, times out, or writes no file.
    FormatError
        If its file is not a results CSV of these images and objects.
    """
    with _temporary(Path(out)) as written:
        boxes = Path(detections.source).resolve()
        if not detections.in_file:
            boxes = written.with_name("detections.json")
            write_detections(boxes, detections)
        paths = {"bop": dataset.root.resolve(), "detections": boxes, "out": written}
        command = command_line(template, paths)
        on_output = partial(progress, 0.0) if progress else None
        run_command(command, timeout_s=timeout_s, on_output=on_output)
        if not written.is_file():
            raise EstimatorFailedError(command, "exited with code 0, but has not written its {out}")
        asked = detections if "{detections}" in template else None
        return _accept(written, Path(out), dataset, asked, lenient=lenient)


@contextmanager
def _temporary(out: Path) -> Iterator[Path]:
    """Yield a path of the same name in a temporary directory beside ``out``."""
    if out.is_dir():
        raise InputError(f"{out}: is a directory, not a file", parameters=("out",))
    with temporary_directory(out.parent) as folder:
        yield folder / out.name


def _accept(
    written: Path,
    out: Path,
    dataset: BopDataset,
    asked: Detections | None,
    *,
    lenient: bool = False,
) -> Results:
    """Check a results file and write it to ``out``; ``asked`` are the detections it was given."""
    source = f"{out.name}, as the estimator wrote it"
    try:
        results = replace(read_results(written, lenient=lenient), source=source)
    except FormatError as error:
        raise FormatError(
            source, error.problem, where=error.where, parameters=error.parameters
        ) from error
    results = _belonging(results, dataset, asked, lenient=lenient)
    if not len(results):
        raise FormatError(source, "holds no pose")
    dataset.models.check_distances(source, results.obj_id, results.cam_T_obj)
    write_results(out, results)
    return replace(results, source=str(out))


def _belonging(
    results: Results, dataset: BopDataset, detections: Detections | None, *, lenient: bool
) -> Results:
    """Check that objects have models, and that images exist and were among those asked for."""
    images = list(zip(results.scene_id.tolist(), results.im_id.tolist(), strict=True))
    asked = set(detections.images()) if detections else set(images)
    models = dataset.models

    def explain_object(i: int) -> str:
        return (
            f"object {results.obj_id[i]} is not in {models.directory / 'models_info.json'}, which "
            f"has {', '.join(map(str, sorted(models.info)))}"
        )

    def explain_image(i: int) -> str:
        scene_id, im_id = images[i]
        return (
            f"there is no image {scene_id}/{im_id} in {dataset.scenes}; scene_id and im_id are the "
            "numbers in the files' names"
        )

    def explain_unasked(i: int) -> str:
        names = [f"{scene_id}/{im_id}" for scene_id, im_id in sorted(asked)]
        some = ", ".join([*names[:5], *(["…"] if len(names) > 5 else [])])
        return (
            f"image {images[i][0]}/{images[i][1]} has no detection; images with detections are "
            f"{some}: is im_id a count instead of the number in the file's name?"
        )

    faults: dict[str, tuple[Iterable[Any], Collection[Any], Callable[[int], str]]] = {
        "object without a model": (results.obj_id, models.info, explain_object),
        "unknown image": (images, dataset.images, explain_image),
        "image without detections": (images, asked, explain_unasked),
    }
    bad = {}
    for fault, (values, known, explain) in faults.items():
        bad[fault] = np.array([value not in known for value in values], dtype=bool)
        if bad[fault].any() and not lenient:
            first = int(np.flatnonzero(bad[fault])[0])
            where = f"line {results.line[first]}"
            raise FormatError(results.source, explain(first), where=where, parameters=("lenient",))
    return _counted(results.select(~np.logical_or.reduce(list(bad.values()))), bad)


def _counted(results: Results, left_out: Mapping[str, Bool[ndarray, " n"]]) -> Results:
    """Add the numbers of skipped rows to ``dropped``."""
    counts = {reason: int(rows.sum()) for reason, rows in left_out.items() if rows.any()}
    return replace(results, dropped={**results.dropped, **counts})
