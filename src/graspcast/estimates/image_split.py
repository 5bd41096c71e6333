"""Parts of the images: what a grasp is fitted on, chosen on, and reported on.

Frames are video, and estimators share them: a trial at random has near copies of itself a few
frames away. So the annotated frames of a scene, in order, are cut into six contiguous blocks, as
equal as can be (the earlier ones are longer by one where need be), and the blocks are dealt fit,
choose, report, fit, choose, report. The part of a trial therefore depends on its dataset, scene
and image alone: not on the estimator, the object, the gripper, a seed, or which other trials there
are. Two blocks of a scene still touch where one ends and the next begins.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from graspcast.bop.dataset import GroundTruth
from graspcast.errors import MismatchError

__all__ = ["BLOCKS", "PARTS", "Frames", "Part", "frames_of", "part_of"]

Part = Literal["fit", "choose", "report"]
PARTS: tuple[Part, ...] = ("fit", "choose", "report")
BLOCKS = 6
"""Contiguous blocks of a scene's frames, dealt in turn to the parts."""

Frames = Mapping[tuple[str, int], Int[ndarray, " f"]]
"""Dataset and scene to its annotated frames, ascending."""


def frames_of(truths: Mapping[str, GroundTruth]) -> dict[tuple[str, int], Int[ndarray, " f"]]:
    """The annotated frames of every scene of some datasets."""
    out = {}
    for dataset, truth in truths.items():
        for scene in np.unique(truth.scene_id).tolist():
            out[dataset, scene] = np.unique(truth.im_id[truth.scene_id == scene])
    return out


def part_of(
    dataset: ndarray, scene_id: Int[ndarray, " n"], im_id: Int[ndarray, " n"], frames: Frames
) -> ndarray:
    """The part of each trial, as text, (n,).

    Raises
    ------
    MismatchError
        For an image that is not among the annotated frames of its scene.
    """
    out = np.empty(len(im_id), dtype="U6")
    names = np.array(PARTS)
    for name, scene in set(zip(dataset.tolist(), scene_id.tolist(), strict=True)):
        rows = np.flatnonzero((dataset == name) & (scene_id == scene))
        known = frames.get((name, scene), np.empty(0, dtype=np.int64))
        place = np.searchsorted(known, im_id[rows])
        found = place < len(known)
        found[found] = known[place[found]] == im_id[rows][found]
        if not found.all():
            raise MismatchError(
                f"{name}, scene {scene}: image {im_id[rows][~found][0]} has no ground truth, so "
                "it belongs to no part of the images"
            )
        sizes = [len(block) for block in np.array_split(known, BLOCKS)]
        block = np.searchsorted(np.cumsum(sizes), place, side="right")
        out[rows] = names[block % len(PARTS)]
    return out
