"""Results of one estimator in several files, one for each object for example, put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from graspcast.bop.results import Results
from graspcast.errors import InputError

__all__ = ["put_together"]

_MOST_NAMED = 3
_COLUMNS = ("scene_id", "im_id", "obj_id", "score", "cam_T_obj", "time_s")


def put_together(estimator: str, parts: Sequence[Results]) -> Results:
    """Put the results of an estimator together, no object of an image in two of them.

    Parameters
    ----------
    estimator
        Its name, for messages.
    parts
        The tables, of one dataset; one of them is returned as it is.

    Raises
    ------
    InputError
        If an object in an image is in two of the tables, naming both, and the lines.
    """
    if len(parts) == 1:
        return parts[0]
    sources = [part.source for part in parts]
    for source in sources:
        if sources.count(source) > 1:
            raise InputError(
                f"{source}: is given twice, as estimates by {estimator}", parameters=("estimates",)
            )
    keys = [np.stack([part.scene_id, part.im_id, part.obj_id], axis=1).tolist() for part in parts]
    first: dict[tuple[int, ...], tuple[int, int]] = {}
    for i, rows in enumerate(keys):
        for row, key in enumerate(map(tuple, rows)):
            j, other = first.setdefault(key, (i, row))
            if j != i:
                scene, image, number = key
                raise InputError(
                    f"{_place(parts[i], row)}: object {number} in image {scene}/{image} is in "
                    f"{_place(parts[j], other)}, too, and both are estimates by {estimator}; give "
                    "one of them, or two names if they are of two estimators",
                    parameters=("estimates",),
                )
    dropped: dict[str, int] = {}
    for part in parts:
        for why, n in part.dropped.items():
            dropped[why] = dropped.get(why, 0) + n
    more = f" and {len(sources) - _MOST_NAMED} more" if len(sources) > _MOST_NAMED else ""
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(p, name) for p in parts]) for name in _COLUMNS
    }
    return replace(
        parts[0],
        **columns,
        # A number alone would not say in which file the line is.
        line=np.zeros(len(columns["obj_id"]), dtype=np.int64),
        source=f"{', '.join(sources[:_MOST_NAMED])}{more}",
        dropped=dropped,
    )


def _place(part: Results, row: int) -> str:
    line = int(part.line[row])
    return f"{part.source}, line {line}" if line else part.source
