"""Scores of instances: the confidence that an estimator published with each of its poses.

:class:`~graspcast.estimates.alignment.Estimates` hold poses alone. A score is found again in the
estimator's results by the key of the instance and its pose, which alignment copies unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.results import Results
from graspcast.errors import MismatchError
from graspcast.estimates.alignment import Estimates
from graspcast.io.arguments import NAME, a, checked, mapping

__all__ = ["scores_of"]


@checked(estimates=a(Estimates), estimator=NAME, results=mapping(a(Results), "dataset"))
def scores_of(
    estimates: Estimates, estimator: str, results: Mapping[str, Results]
) -> Float[ndarray, " n"]:
    """Look up an estimator's score of each instance.

    ``est_id`` is the rank among the sane estimates of the anchor alone, so it does not tell which
    row of a file an instance is; the pose does. Of rows with one and the same pose, the highest
    score counts.

    Parameters
    ----------
    estimates
        Aligned estimates.
    estimator
        One of their estimators.
    results
        Dataset's name to the estimator's results, those that were aligned.

    Returns
    -------
        NaN for the instances of a dataset whose results are not given, (n,).

    Raises
    ------
    UnknownNameError
        For an estimator that is none of the estimates'.
    MismatchError
        If the results of a dataset lack the pose of an instance of it.
    """
    poses = estimates.of(estimator)
    out = np.full(len(estimates), np.nan)
    known = {name: _by_pose(table) for name, table in results.items()}
    for i, key in enumerate(estimates.instances.to_keys()):
        if key.dataset not in known:
            continue
        score = known[key.dataset].get((*key.image, key.obj_id, _bytes(poses[i])))
        if score is None:
            raise MismatchError(
                f"{results[key.dataset].source}: has no estimate with the pose by {estimator} of "
                f"{key}; these are not the results that the estimates were made from",
                parameters=("estimates",),
            )
        out[i] = score
    return out


def _by_pose(results: Results) -> dict[tuple[int, int, int, bytes], float]:
    """Return the scores by scene, image, object and pose."""
    ids = (results.scene_id, results.im_id, results.obj_id)
    out: dict[tuple[int, int, int, bytes], float] = {}
    for i, key in enumerate(zip(*map(np.ndarray.tolist, ids), strict=True)):
        place = (*key, _bytes(results.cam_T_obj[i]))
        score = float(results.score[i])
        out[place] = max(score, out.get(place, score))
    return out


def _bytes(pose: Float[ndarray, "4 4"]) -> bytes:
    """Return a pose as it can be looked up; 0 and -0 are the same."""
    return (np.asarray(pose, dtype=np.float64) + 0.0).tobytes()
