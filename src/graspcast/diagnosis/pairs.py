"""Pairs of sources of poses, side by side: estimators with each other and with ground truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.bop.dataset import GroundTruth
from graspcast.bop.results import Results
from graspcast.diagnosis.case import Case, Scenes
from graspcast.estimates.alignment import align
from graspcast.pose.metrics import nearest_symmetric
from graspcast.pose.transforms import compose, invert, rotation_angle

__all__ = ["TRUTH", "Pair", "as_results", "pairs_of", "sources_of"]

TRUTH = "ground truth"
"""The name of ground truth among sources of poses."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Poses of the same n instances by two sources.

    Attributes
    ----------
    one, other
        Names of the sources.
    images
        Scene and image of each instance, (n, 2).
    obj_id
        Objects, (n,).
    poses, others
        Poses by either, metres, (n, 4, 4).
    """

    one: str
    other: str
    images: Int[ndarray, "n 2"]
    obj_id: Int[ndarray, " n"]
    poses: Float[ndarray, "n 4 4"]
    others: Float[ndarray, "n 4 4"]

    def __len__(self) -> int:
        return len(self.obj_id)

    def swapped(self) -> Pair:
        """Return the pair with its sources exchanged."""
        return Pair(self.other, self.one, self.images, self.obj_id, self.others, self.poses)

    def differences(self, case: Case) -> Float[ndarray, "n 4 4"]:
        """Return ``one_T_other`` of each instance, by the nearest of the stated symmetries."""
        out = compose(invert(self.poses), self.others)
        for obj_id in np.unique(self.obj_id).tolist():
            mine = self.obj_id == obj_id
            out[mine] = nearest_symmetric(out[mine], case.symmetries(obj_id))
        return out

    def apart(self, case: Case) -> Float[ndarray, " n"]:
        """Return how far apart the poses are, in diameters: offset across the ray, and turn.

        The offset along the viewing ray, in which estimates are worst, counts a quarter.
        """
        turn = rotation_angle(self.differences(case)[:, :3, :3])
        return np.hypot(self.shifts(case), np.minimum(turn, 1.0) / 2)

    def shifts(self, case: Case) -> Float[ndarray, " n"]:
        """Return the offsets in diameters, with a quarter of the part along the viewing ray."""
        size = np.array([case.diameter_m(i) for i in self.obj_id.tolist()])
        size = np.where(np.isfinite(size), size, 0.15)
        offset = self.others[:, :3, 3] - self.poses[:, :3, 3]
        ray = self.others[:, :3, 3] / np.linalg.norm(self.others[:, :3, 3], axis=1)[:, None]
        along = (offset * ray).sum(axis=1)
        across = np.linalg.norm(offset - along[:, None] * ray, axis=1)
        return np.asarray(np.hypot(across, along / 4) / size)


def sources_of(case: Case) -> tuple[dict[str, Results], Scenes | None]:
    """Return all sound sources of poses by name, and the scenes whose true poses are one of them.

    Of several directories of ground truth the one that knows most of the estimates' images.
    """
    out = case.sound
    images = {
        key for t in out.values() for key in zip(t.scene_id.tolist(), t.im_id.tolist(), strict=True)
    }
    best, most = None, 0
    for scenes in case.truths:
        truth = scenes.truth
        if truth is None or TRUTH in case.blamed:
            continue
        known = set(zip(truth.scene_id.tolist(), truth.im_id.tolist(), strict=True))
        if len(known & images) > most:
            best, most = scenes, len(known & images)
    if best is not None and best.truth is not None:
        out[TRUTH] = as_results(best.truth)
    return out, best


def as_results(truth: GroundTruth) -> Results:
    """Return true poses as if an estimator had found them."""
    n = len(truth)
    return Results(
        scene_id=truth.scene_id,
        im_id=truth.im_id,
        obj_id=truth.obj_id,
        score=-truth.gt_id.astype(np.float64),
        cam_T_obj=truth.cam_T_obj,
        time_s=np.full(n, -1.0),
        line=np.zeros(n, dtype=np.int64),
        source=truth.source,
    )


def pairs_of(sources: Mapping[str, Results], dataset: str) -> dict[tuple[str, str], Pair]:
    """Align every two sources that have instances in common."""
    keys = {
        name: set(zip(t.scene_id.tolist(), t.im_id.tolist(), t.obj_id.tolist(), strict=True))
        for name, t in sources.items()
    }
    out = {}
    for one, other in combinations(sources, 2):
        if keys[one].isdisjoint(keys[other]):
            continue
        both = align({one: sources[one], other: sources[other]}, dataset=dataset, required=False)
        if len(both):
            images = np.stack([both.scene_id, both.im_id], axis=1)
            out[one, other] = Pair(one, other, images, both.obj_id, *both.cam_T_obj)
    return out
