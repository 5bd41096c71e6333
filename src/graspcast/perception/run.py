"""An estimator on the images of a dataset: detections in, a results CSV out, or nothing."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import Detections
from graspcast.bop.results import Results, read_results, write_results
from graspcast.errors import EstimatorFailedError, FormatError, InputError, UnknownNameError
from graspcast.perception.estimator import Estimator
from graspcast.perception.external import command_line, run_command
from graspcast.pose.transforms import is_identity

__all__ = ["run_estimator", "run_external"]


def run_estimator(
    estimator: Estimator,
    dataset: BopDataset,
    detections: Detections,
    out: str | PathLike[str],
    *,
    lenient: bool = False,
    progress: Callable[[float, str], None] | None = None,
) -> Results:
    """Estimate image by image and write a BOP results CSV.

    Its time column holds the seconds that :meth:`Estimator.estimate` took for the image; the
    detector's are not in it. Images without detections are not looked at; detections for which
    nothing is found have no row.

    Parameters
    ----------
    estimator
        One of our own, or any that keeps to the protocol.
    dataset
        Whose images are read.
    detections
        What to look at.
    out
        Where the results are to be.
    lenient
        Leave out detections of objects that the estimator does not know, and count them.
    progress
        Takes the share of images done and the image that comes next.

    Returns
    -------
        The results that now are at ``out``.

    Raises
    ------
    UnknownNameError
        For a detected object that the estimator does not know.
    InputError
        If an image cannot be read, or ``out`` cannot be written.
    FormatError
        If what the estimator returns are no poses.
    """
    known = np.isin(detections.obj_id, estimator.obj_ids)
    if not known.all() and not lenient:
        raise UnknownNameError(
            "object",
            detections.obj_id[~known][0],
            sorted(estimator.obj_ids),
            hint=f"{estimator.name} was trained for these; {detections.source} has others too, "
            "which --lenient leaves out",
        )
    with _aside(Path(out)) as written:
        images = detections.select(known).images()
        parts = []
        for i, (key, seen) in enumerate(images.items()):
            if progress:
                progress(i / len(images), "image {}/{}".format(*key))
            image, camera = dataset.image(*key), dataset.camera_of(*key)
            start = time.perf_counter()
            poses = estimator.estimate(image, camera.K, seen)
            took = time.perf_counter() - start
            found = ~is_identity(poses.cam_T_obj)
            rows = (seen.scene_id[found], seen.im_id[found], seen.obj_id[found])
            seconds = np.full(len(rows[0]), took)
            parts.append((*rows, poses.score[found], poses.cam_T_obj[found], seconds))
        if not parts:
            raise InputError(f"{detections.source}: no detection that {estimator.name} could use")
        scene_id, im_id, obj_id, score, cam_T_obj, time_s = map(
            np.concatenate, zip(*parts, strict=True)
        )
        line = np.zeros(len(obj_id), dtype=np.int64)
        table = Results(scene_id, im_id, obj_id, score, cam_T_obj, time_s, line)
        write_results(written, table)
        results = _accept(written, Path(out), dataset, detections)
    return _counted(results, {"object that the estimator does not know": ~known})


def run_external(
    template: str,
    dataset: BopDataset,
    detections: Detections,
    out: str | PathLike[str],
    *,
    timeout_s: float | None = None,
    lenient: bool = False,
    say: Callable[[str], None] | None = None,
) -> Results:
    """Run an estimator that is a command and write its poses as a BOP results CSV.

    The command writes beside ``out``, to a directory that is removed in any case. Only what has
    passed the checks of any results CSV is written to ``out``; the poses are the very same.

    Parameters
    ----------
    template
        The command, with ``{out}`` and, where it needs them, ``{bop}`` and ``{detections}``, filled
        in as absolute paths; see :func:`graspcast.perception.external.command_line`. Poses in an
        image without detections are refused if it is given the detections.
    dataset
        Whose images it is to look at.
    detections
        As read from a file.
    out
        Where the results are to be.
    timeout_s
        The command is ended after so many seconds.
    lenient
        Leave out rows that are wrong, and count them.
    say
        Takes each line that the command prints.

    Returns
    -------
        The results that now are at ``out``.

    Raises
    ------
    InputError
        For a template that is no command, or an ``out`` that cannot be written.
    EstimatorFailedError
        If the command cannot be started, fails, takes too long, or writes no file.
    FormatError
        If its file is no results CSV of these images and objects.
    """
    with _aside(Path(out)) as written:
        paths = {
            "bop": dataset.root.resolve(),
            "detections": Path(detections.source).resolve(),
            "out": written,
        }
        command = command_line(template, paths)
        run_command(command, timeout_s=timeout_s, **({"say": say} if say else {}))
        if not written.is_file():
            raise EstimatorFailedError(command, "ended well, but has not written its {out}")
        told = "{detections}" in template
        return _accept(written, Path(out), dataset, detections, told=told, lenient=lenient)


@contextmanager
def _aside(out: Path) -> Iterator[Path]:
    """A path of the same name beside ``out``, in a directory that is removed afterwards."""
    if out.is_dir():
        raise InputError(f"{out}: is a directory; --out takes a file")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        folder = tempfile.TemporaryDirectory(
            prefix=f".{out.name}.", dir=out.parent, ignore_cleanup_errors=True
        )
    except OSError as error:
        raise InputError(
            f"{out}: cannot be written ({error.strerror}); give another --out"
        ) from error
    with folder as name:
        yield Path(name).resolve() / out.name


def _accept(
    written: Path,
    out: Path,
    dataset: BopDataset,
    detections: Detections,
    *,
    told: bool = True,
    lenient: bool = False,
) -> Results:
    """Check a results file and write it to its place."""
    source = f"{out.name}, as the estimator wrote it"
    try:
        results = replace(read_results(written, lenient=lenient), source=source)
    except FormatError as error:
        raise FormatError(source, error.problem, where=error.where) from error
    results = _belonging(results, dataset, detections if told else None, lenient=lenient)
    if not len(results):
        raise FormatError(source, f"holds no pose; there were {len(detections)} detections")
    write_results(out, results)
    return replace(results, source=str(out))


def _belonging(
    results: Results, dataset: BopDataset, detections: Detections | None, *, lenient: bool
) -> Results:
    """The rows about objects with models and about images that are there, and that were given."""
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
            f"image {images[i][0]}/{images[i][1]} has no detection; there are some in {some}: are "
            "images counted, where they should be named?"
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
            raise FormatError(results.source, explain(first), where=where)
    return _counted(results.select(~np.logical_or.reduce(list(bad.values()))), bad)


def _counted(results: Results, left_out: Mapping[str, Bool[ndarray, "n"]]) -> Results:
    """Results that also state how many rows were left out, and why."""
    counts = {reason: int(rows.sum()) for reason, rows in left_out.items() if rows.any()}
    return replace(results, dropped={**results.dropped, **counts})
