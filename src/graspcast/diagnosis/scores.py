"""Scores and times that carry nothing, and poses that come twice."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy import ndarray

from graspcast.bop.results import Results
from graspcast.diagnosis.case import Case
from graspcast.diagnosis.finding import Finding

__all__ = ["repeated_poses", "score_findings"]

_LEAST = 5
_REPEATED = 0.05


def score_findings(case: Case) -> Iterator[Finding]:
    """Say which tables have one score for everything, or one time."""
    for name, table in case.results.items():
        if len(table) < _LEAST:
            continue
        keys = np.stack([table.scene_id, table.im_id, table.obj_id], axis=1)
        several = len(np.unique(keys, axis=0)) < len(keys)
        times = np.unique(table.time_s)
        told = "" if len(times) > 1 or times[0] < 0 else f", and all times {times[0]:g} s"
        if len(np.unique(table.score)) == 1:
            score = float(table.score[0])
            yield Finding(
                "warning" if several else "note",
                "scores-constant",
                table.source,
                f"all {len(table)} scores are {score:g}{told}"
                + (
                    "; some images show an object several times, and which estimate is the best "
                    "is not known"
                    if several
                    else ""
                ),
                "Write the estimator's own confidence, if it has one",
                {"score": score, "estimates": len(table)},
                estimator=name,
            )
        elif told:
            yield Finding(
                "note",
                "times-constant",
                table.source,
                f"all {len(table)} times are {times[0]:g} s",
                "Write -1 where times were not measured",
                {"time_s": float(times[0])},
                estimator=name,
            )
    for detections in case.detections:
        boxes = detections.score
        if len(boxes) >= _LEAST and len(np.unique(boxes)) == 1 and not detections.detector:
            yield Finding(
                "note",
                "scores-constant",
                detections.source,
                f"all {len(boxes)} scores are {boxes[0]:g}",
                "Write the detector's own confidence, if it has one",
                {"score": float(boxes[0])},
            )


def repeated_poses(case: Case) -> Iterator[Finding]:
    """Say which tables have the very same poses in several images."""
    for name, table in case.results.items():
        found = _repeated(table)
        if found is None:
            continue
        count, first, second = found
        yield Finding(
            "warning",
            "poses-repeated",
            table.source,
            f"{count} of {len(table)} poses are, to the last digit, those of the same object in "
            f"another image: image {_image(table, first)} and {_image(table, second)}, object "
            f"{table.obj_id[first]}",
            "Leave the images out that are others once more",
            {"repeated": count, "estimates": len(table)},
            estimator=name,
        )


def _image(table: Results, row: int) -> str:
    return f"{table.scene_id[row]}/{table.im_id[row]}"


def _repeated(table: Results) -> tuple[int, int, int] | None:
    seen: dict[tuple[int, bytes], int] = {}
    count, example = 0, (0, 0)
    poses: ndarray = np.ascontiguousarray(table.cam_T_obj)
    for row, obj_id in enumerate(table.obj_id.tolist()):
        first = seen.setdefault((obj_id, poses[row].tobytes()), row)
        if first != row:
            count, example = count + 1, (example if count else (first, row))
    if count < 3 or count < _REPEATED * len(table):
        return None
    return count, *example
