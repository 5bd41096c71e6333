"""Choice among detections: by score, the best of each object in an image, and by targets."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from graspcast.bop.detections import Detections
from graspcast.bop.targets import Target
from graspcast.errors import InputError

__all__ = ["chosen"]


def chosen(
    detections: Detections,
    *,
    min_score: float | None = None,
    top: int | None = None,
    targets: Iterable[Target] | None = None,
) -> Detections:
    """Return the detections that meet all conditions, in their order.

    Parameters
    ----------
    detections
        The detections.
    min_score
        The least score.
    top
        The most detections of an object in an image: those with the highest scores.
    targets
        The objects in images that are wanted; for a target without an object (bop24), all of its
        image.

    Returns
    -------
        They; ``remarks`` say how many were left out.

    Raises
    ------
    InputError
        If none is left, with the highest score, or the images of the file.
    """
    keep = np.ones(len(detections), dtype=bool)
    said = []
    keys = [detections.scene_id, detections.im_id, detections.obj_id]
    rows = list(map(tuple, np.stack(keys, axis=1).tolist()))
    if targets is not None:
        wanted = {(t.scene_id, t.im_id, t.obj_id) for t in targets}
        asked = [(s, i, o) in wanted or (s, i, None) in wanted for s, i, o in rows]
        keep &= np.array(asked, dtype=bool)
        said.append(f"{int((~keep).sum())} are no targets")
    if min_score is not None:
        low = keep & (detections.score < min_score)
        said.append(f"{int(low.sum())} have a score below {min_score:g}")
        keep &= ~low
    if top is not None:
        before = int(keep.sum())
        seen: dict[tuple[int, ...], int] = {}
        for i in np.argsort(-detections.score, kind="stable").tolist():
            if keep[i]:
                seen[rows[i]] = seen.get(rows[i], 0) + 1
                keep[i] = seen[rows[i]] <= top
        said.append(f"{before - int(keep.sum())} are not among the best {top} of their object")
    if not said:
        return detections
    remark = f"{detections.source}: of {len(detections)} detections {', '.join(said)}"
    if not keep.any():
        highest = f"{float(detections.score.max()):g}" if len(detections) else "none"
        raise InputError(
            f"{remark}; none is left (the highest score is {highest})",
            parameters=("min_score", "targets"),
        )
    out = detections.select(keep)
    return replace(out, remarks=(*detections.remarks, remark), in_file=False)
