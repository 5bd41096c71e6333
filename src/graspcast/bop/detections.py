"""2D detections: objects and their bounding boxes in images, the input of pose estimators.

Format: https://bop.felk.cvut.cz/challenges/bop-challenge-2022/ (Section 5.1), a JSON list of
``{scene_id, image_id, category_id, score, bbox, …}`` with the box as x, y, width, height in pixels.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.box_conventions import check_convention
from graspcast.bop.dataset import BopDataset, GroundTruth, Target
from graspcast.bop.detection_files import read_detection_file
from graspcast.bop.summary import summary
from graspcast.errors import FormatError, InputError
from graspcast.io.arguments import PATH, checked
from graspcast.io.json import identifier, numbers, require, write_json

__all__ = ["Detections", "jittered", "read_detections", "write_detections"]

MIN_VISIBLE_FRACTION = 0.1
"""Visible fraction below which an instance is no target in BOP.

Hodan et al., *BOP Challenge 2020*, Section 2.1.
"""

MIN_SIDE_PX = 1.0
"""Width and height below which a box is none."""


@dataclass(frozen=True, eq=False)
class Detections:
    """Detected objects, in the order of the file.

    Attributes
    ----------
    scene_id, im_id, obj_id
        BOP ids, (n,).
    score
        The detector's confidence, (n,); any finite number.
    box_xywh
        Left, top, width, height in pixels, (n, 4). Boxes are amodal: they enclose occluded parts
        too, and may extend beyond the image, but overlap it.
    source
        The file they came from, for messages.
    detector
        What produced them, if the file states it.
    dropped
        How many entries were left out, by reason.
    remarks
        What is odd about them, in words.
    in_file
        Whether the file, of the form of the BOP Challenge, may be given to others in their place.
    """

    scene_id: Int[ndarray, " n"]
    im_id: Int[ndarray, " n"]
    obj_id: Int[ndarray, " n"]
    score: Float[ndarray, " n"]
    box_xywh: Float[ndarray, "n 4"]
    source: str = "detections"
    detector: str = ""
    dropped: Mapping[str, int] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    in_file: bool = False

    def __len__(self) -> int:
        return len(self.obj_id)

    def __repr__(self) -> str:
        return f"Detections({summary(self, 'detection')})"

    def select(self, which: Bool[ndarray, " n"] | Int[ndarray, " m"]) -> Detections:
        """Return some of the rows, by mask or by row number."""
        names = ("scene_id", "im_id", "obj_id", "score", "box_xywh")
        return replace(self, in_file=False, **{n: getattr(self, n)[which] for n in names})

    def images(self) -> dict[tuple[int, int], Detections]:
        """Group the detections by image: (scene_id, im_id), in ascending order, to detections."""
        rows: dict[tuple[int, int], list[int]] = {}
        for i, key in enumerate(zip(self.scene_id.tolist(), self.im_id.tolist(), strict=True)):
            rows.setdefault(key, []).append(i)
        return {key: self.select(np.array(rows[key])) for key in sorted(rows)}


@checked(path=PATH)
def read_detections(
    path: str | PathLike[str], dataset: BopDataset | None = None, *, lenient: bool = False
) -> Detections:
    """Read a detections file; masks and run times in it are not used.

    It has the form of the BOP Challenge, of GDRNPP and ZebraPose, or of COCO
    (:mod:`graspcast.bop.detection_files`).

    Parameters
    ----------
    path
        The JSON file, or ``.json.gz``.
    dataset
        The dataset that they should belong to; if given, images and objects are checked.
    lenient
        Skip bad entries and count them in ``dropped``, instead of raising.

    Raises
    ------
    FormatError
        Naming file and entry: a missing key, a number that is not finite, an empty or a repeated
        box, or one below a pixel; and, given a dataset, an unknown image or object, or a box
        outside of the image. Also, whether lenient or not, if the boxes are shares of the image or
        pairs of corners.
    """
    file = read_detection_file(path)
    checks = _Checks(dataset)
    boxes, images = _boxes(file.entries, path)
    remarks = check_convention(boxes, checks.size, path, lambda: checks.sizes(images))
    rows: list[tuple[int, int, int, float, list[float]]] = []
    makers: set[str] = set()
    dropped: Counter[str] = Counter()
    for entry, where in zip(file.entries, file.places, strict=True):
        try:
            row = _parse(entry, path, where)
            checks.box(row, path, where)
        except FormatError:
            if not lenient:
                raise
            dropped["bad entry"] += 1
            continue
        if problem := checks.unknown(row):
            reason, message = problem
            if not lenient:
                raise FormatError(path, message, where=where, parameters=("lenient",))
            dropped[reason] += 1
            continue
        rows.append(row)
        makers.add(str(entry.get("detector", "")))
    return Detections(
        scene_id=np.array([r[0] for r in rows], dtype=np.int64),
        im_id=np.array([r[1] for r in rows], dtype=np.int64),
        obj_id=np.array([r[2] for r in rows], dtype=np.int64),
        score=np.array([r[3] for r in rows], dtype=np.float64),
        box_xywh=np.array([r[4] for r in rows], dtype=np.float64).reshape(-1, 4),
        source=str(path),
        detector=", ".join(sorted(makers - {""})),
        dropped=dict(dropped),
        remarks=remarks,
        in_file=file.is_bop,
    )


def _boxes(
    entries: list[Any], path: str | PathLike[str]
) -> tuple[Float[ndarray, "n 4"], list[tuple[Any, Any]]]:
    """Return the boxes of a file, without entries that have none, and their scenes and images."""
    found, images = [], []
    for entry in entries:
        if isinstance(entry, dict) and "bbox" in entry:
            with suppress(FormatError):
                found.append(numbers(entry["bbox"], (4,), path, "bbox"))
                images.append((entry.get("scene_id"), entry.get("image_id")))
    return np.array(found, dtype=np.float64).reshape(-1, 4), images


_Row = tuple[int, int, int, float, list[float]]


def _parse(entry: Any, path: str | PathLike[str], where: str) -> _Row:
    scene_id, im_id, obj_id = (
        identifier(require(entry, key, path, where), path, f"{where}, {key}")
        for key in ("scene_id", "image_id", "category_id")
    )
    score = float(numbers(require(entry, "score", path, where), (), path, f"{where}, score"))
    box = numbers(require(entry, "bbox", path, where), (4,), path, f"{where}, bbox")
    return scene_id, im_id, obj_id, score, box.tolist()


class _Checks:
    """Checks of the entries of one file, against the dataset and against each other."""

    def __init__(self, dataset: BopDataset | None):
        self.dataset = dataset
        self.size = dataset.image_size if dataset else None
        self.seen: dict[tuple[object, ...], str] = {}

    def sizes(self, images: Iterable[tuple[Any, Any]]) -> Float[ndarray, "n 2"]:
        """Return width and height of images, NaN where they are unknown."""
        known: dict[tuple[int, int], tuple[float, float]] = {}
        out = []
        for key in images:
            size: tuple[float, float] | None = None
            if self.dataset is not None and all(isinstance(part, int) for part in key):
                size = known.get(key) or self.dataset.size_of(*key)
                known[key] = size or (np.nan, np.nan)
            out.append(size or (np.nan, np.nan))
        return np.array(out, dtype=np.float64).reshape(-1, 2)

    def box(self, row: _Row, path: str | PathLike[str], where: str) -> None:
        scene_id, im_id, obj_id, _, (x, y, width, height) = row
        if not (width > 0 and height > 0):
            raise FormatError(
                path,
                f"the box [{x:g}, {y:g}, {width:g}, {height:g}] is empty; a box is x, y, width, "
                "height in pixels, not two corners",
                where=where,
            )
        if min(width, height) < MIN_SIDE_PX:
            raise FormatError(
                path,
                f"the box [{x:g}, {y:g}, {width:g}, {height:g}] is smaller than {MIN_SIDE_PX:g} "
                "pixel; a box is x, y, width, height in pixels",
                where=where,
            )
        size = self.size
        if size is None or not _meets((x, y, width, height), size):
            size = self.dataset.size_of(scene_id, im_id) if self.dataset else None
        if size and not _meets((x, y, width, height), size):
            raise FormatError(
                path,
                f"the box [{x:g}, {y:g}, {width:g}, {height:g}] lies outside of the image, which "
                f"has {size[0]} x {size[1]} pixels",
                where=where,
            )
        first = self.seen.setdefault((scene_id, im_id, obj_id, x, y, width, height), where)
        if first != where:
            raise FormatError(path, f"repeats the object and box of {first}", where=where)

    def unknown(self, row: _Row) -> tuple[str, str] | None:
        """Return reason and message if the dataset lacks the entry's image or object, else None."""
        if self.dataset is None:
            return None
        scene_id, im_id, obj_id = row[:3]
        if (scene_id, im_id) not in self.dataset.images:
            return "unknown image", f"no image {scene_id}/{im_id} in {self.dataset.scenes}"
        models = self.dataset.models
        if obj_id not in models.info:
            known = ", ".join(map(str, sorted(models.info)))
            return (
                "object without a model",
                f"object {obj_id} is not in {models.directory / 'models_info.json'}, which has "
                f"{known}",
            )
        return None


def _meets(box_xywh: Iterable[float], size: tuple[int, int]) -> bool:
    x, y, width, height = box_xywh
    return x < size[0] and y < size[1] and x + width > 0 and y + height > 0


def write_detections(path: str | PathLike[str], detections: Detections) -> None:
    """Write a BOP detections file; :func:`read_detections` returns exactly the same numbers."""
    maker = {"detector": detections.detector} if detections.detector else {}
    entries = [
        {
            "scene_id": int(detections.scene_id[i]),
            "image_id": int(detections.im_id[i]),
            "category_id": int(detections.obj_id[i]),
            "score": float(detections.score[i]),
            "bbox": detections.box_xywh[i].tolist(),
            "time": -1.0,
            **maker,
        }
        for i in range(len(detections))
    ]
    write_json(path, entries, one_entry_a_line=True)


def jittered(
    dataset: BopDataset,
    seed: int,
    *,
    targets: Iterable[Target] | None = None,
    shift: float = 0.05,
    scale: float = 0.05,
) -> Detections:
    """Make detections from ground-truth boxes by random displacement, in place of a detector.

    The centre of each box is moved by at most ``shift`` of its size, and each side is scaled by at
    most ``scale``, uniformly at random; a box that would then lie outside of the image is left
    unchanged. The score is 1. There are no false positives, no false negatives and no confused
    classes, so estimates from these boxes say nothing about a detector; ``detector`` of the table,
    and of every entry of a file written from it, says so. An instance's box depends only on its
    ids and the seed.

    Parameters
    ----------
    dataset
        A dataset with ``scene_gt_info.json``, whose ``bbox_obj`` are the boxes.
    seed
        Seed of the random displacements.
    targets
        Restrict the detections to these objects, at any visibility; for a target without an object
        (bop24), to its image's objects that are at least 10 % visible. Without targets, all objects
        that are at least 10 % visible.
    shift
        Largest displacement as a fraction of width and height.
    scale
        Largest change of width and height as a fraction of them.

    Raises
    ------
    InputError
        If the ground truth has no boxes, or no instance is visible enough.
    """
    truth = dataset.ground_truth
    if truth.box_xywh is None or np.isnan(truth.box_xywh).all():
        raise InputError(f"{truth.source}: no scene_gt_info.json here has a bbox_obj")
    keep = truth.visib_fract >= MIN_VISIBLE_FRACTION
    if targets is not None:
        wanted = {(t.scene_id, t.im_id, t.obj_id) for t in targets}
        rows = np.column_stack([truth.scene_id, truth.im_id, truth.obj_id]).tolist()
        named = np.array([(s, i, o) in wanted for s, i, o in rows], dtype=bool)
        in_image = np.array([(s, i, None) in wanted for s, i, _ in rows], dtype=bool)
        keep = named | (in_image & keep)
    keep &= (truth.box_xywh[:, 2:] > 0).all(axis=1)  # neither unknown nor out of the image
    chosen = np.flatnonzero(keep)
    boxes = truth.box_xywh[chosen]
    number = _numbers_in_image(truth)
    for box, i in zip(boxes, chosen, strict=True):
        numbers_of = (truth.scene_id[i], truth.im_id[i], truth.obj_id[i], number[i])
        draw = np.random.default_rng([seed, *map(int, numbers_of)]).uniform(-1, 1, 4)
        size = box[2:] * (1 + scale * draw[2:])
        moved = np.array([*(box[:2] + box[2:] * (0.5 + shift * draw[:2]) - size / 2), *size])
        if dataset.image_size is None or _meets(moved.tolist(), dataset.image_size):
            box[:] = moved
    if not len(chosen):
        raise InputError(
            f"{truth.source}: none of the instances is at least {MIN_VISIBLE_FRACTION:.0%} visible"
        )
    return Detections(
        scene_id=truth.scene_id[chosen],
        im_id=truth.im_id[chosen],
        obj_id=truth.obj_id[chosen],
        score=np.ones(len(chosen)),
        box_xywh=boxes,
        source=truth.source,
        detector=f"jittered ground truth, seed {seed}, not a detector",
    )


def _numbers_in_image(truth: GroundTruth) -> list[int]:
    """Count each instance among those of its object in its image, from 0."""
    earlier: Counter[tuple[int, int, int]] = Counter()
    out = []
    for key in zip(
        truth.scene_id.tolist(), truth.im_id.tolist(), truth.obj_id.tolist(), strict=True
    ):
        out.append(earlier[key])
        earlier[key] += 1
    return out
