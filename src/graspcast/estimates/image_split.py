"""Split of the images into train, validation and test for the search of reference grasps.

The images are video frames, so images a few frames apart are nearly the same. The annotated frames
of each scene, in order, are therefore cut into six contiguous blocks of equal size (the first ones
are longer by one frame where the number is not divisible), and the blocks are assigned in turn:
train, validation, test, train, validation, test. The split of a trial depends only on its dataset,
scene and image. Neighbouring blocks still touch at their border.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from graspcast.bop.dataset import GroundTruth
from graspcast.errors import MismatchError

__all__ = ["BLOCKS", "SPLITS", "Frames", "Split", "frames_of", "split_of"]

Split = Literal["train", "validation", "test"]
SPLITS: tuple[Split, ...] = ("train", "validation", "test")
BLOCKS = 6
"""Number of contiguous blocks of frames in a scene."""

Frames = Mapping[tuple[str, int], Int[ndarray, " f"]]
"""Annotated frames, ascending, by dataset and scene."""


def frames_of(truths: Mapping[str, GroundTruth]) -> dict[tuple[str, int], Int[ndarray, " f"]]:
    """Return the annotated frames of every scene, from the ground truth of each dataset."""
    out = {}
    for dataset, truth in truths.items():
        for scene in np.unique(truth.scene_id).tolist():
            out[dataset, scene] = np.unique(truth.im_id[truth.scene_id == scene])
    return out


def split_of(
    dataset: ndarray, scene_id: Int[ndarray, " n"], im_id: Int[ndarray, " n"], frames: Frames
) -> ndarray:
    """Return the split (``train``, ``validation`` or ``test``) of each trial as text, (n,).

    Raises
    ------
    MismatchError
        If an image is not among the annotated frames of its scene.
    """
    names = np.array(SPLITS)
    out = np.empty(len(im_id), dtype=names.dtype)
    for name, scene in set(zip(dataset.tolist(), scene_id.tolist(), strict=True)):
        rows = np.flatnonzero((dataset == name) & (scene_id == scene))
        known = frames.get((name, scene), np.empty(0, dtype=np.int64))
        place = np.searchsorted(known, im_id[rows])
        found = place < len(known)
        found[found] = known[place[found]] == im_id[rows][found]
        if not found.all():
            raise MismatchError(
                f"{name}, scene {scene}: image {im_id[rows][~found][0]} has no ground truth, so "
                "it belongs to no split",
                parameters=("ground_truth",),
            )
        sizes = [len(block) for block in np.array_split(known, BLOCKS)]
        block = np.searchsorted(np.cumsum(sizes), place, side="right")
        out[rows] = names[block % len(SPLITS)]
    return out
