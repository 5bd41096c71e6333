"""Objects in a frame of which no estimator has a pose that can be, and placeholders."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.estimates.checks import no_estimate_by
from graspcast.io.wording import counted
from graspcast.pose.sanity import is_placeholder, pose_problems
from graspcast.runtime.frame import Frame

__all__ = ["left_out_notes", "nothing_sane"]


def nothing_sane(
    frame: Frame,
    judged: Collection[str],
    diameters_of: Callable[[ndarray], Float[ndarray, " n"]],
) -> dict[str, str]:
    """Return the objects that were not judged, and why: what is wrong with each estimator's pose.

    Parameters
    ----------
    frame
        The frame; placeholders for "nothing found" are left out.
    judged
        Names of objects that were judged.
    diameters_of
        Returns diameters by objects' names, metres, NaN where unknown.
    """
    out: dict[str, dict[str, str]] = {}
    for estimator, given in frame.estimates.items():
        for estimate in given:
            name, pose = estimate.object_name, estimate.cam_T_obj[None]
            if name in judged or is_placeholder(pose)[0]:
                continue
            (problem,) = pose_problems(pose, diameters_of(np.array([name])))
            out.setdefault(name, {}).setdefault(estimator, problem)
    return {name: no_estimate_by(tuple(said), said) for name, said in sorted(out.items())}


def left_out_notes(frame: Frame) -> list[str]:
    """Say of each estimator which placeholders and repeated poses it gave, or nothing."""
    out = [
        f"{estimator} gave {counted(len(named), 'pose')} again, bit by bit, and each is judged "
        f"once: {_some(named)}"
        for estimator, named in frame.repeated.items()
    ]
    for estimator, given in frame.estimates.items():
        if not given:
            continue
        empty = is_placeholder(np.array([estimate.cam_T_obj for estimate in given]))
        if empty.any():
            named = [given[i].object_name for i in np.flatnonzero(empty).tolist()]
            out.append(
                f"{len(named)} of {len(given)} poses by {estimator} lie at the camera's centre, "
                f"placeholders for 'nothing found', and are left out: {_some(named)}"
            )
    return out


def _some(names: Sequence[str]) -> str:
    """Return the first five different names."""
    different = list(dict.fromkeys(names))
    return ", ".join(different[:5]) + (", …" if len(different) > 5 else "")
