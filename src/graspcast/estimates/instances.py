"""TODO."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy import ndarray

from graspcast.estimates.alignment import Estimates

__all__ = ["UnitKind", "scene_groups", "unit_names"]

UnitKind = Literal["scene", "image"]


def unit_names(estimates: Estimates, kind: UnitKind) -> ndarray:
    """The scene (``dataset/scene``) or image (``dataset/scene/image``) of each instance."""
    columns = [estimates.dataset.tolist(), estimates.scene_id.tolist()]
    if kind == "image":
        columns.append(estimates.im_id.tolist())
    return np.array(["/".join(map(str, row)) for row in zip(*columns, strict=True)])


def scene_groups(estimates: Estimates, *, blocks: int = 5) -> ndarray:
    """A name for each instance's scene.

    A dataset's only scene is cut into ``blocks`` contiguous runs of frames of about equal size,
    since it could not be split otherwise.
    """
    names = np.array(
        [f"{d}/{s}" for d, s in zip(estimates.dataset, estimates.scene_id, strict=True)],
        dtype=object,
    )
    for dataset in np.unique(estimates.dataset):
        mine = estimates.dataset == dataset
        if len(np.unique(names[mine])) > 1:
            continue
        frames = np.unique(estimates.im_id[mine])
        block = np.searchsorted(frames, estimates.im_id[mine]) * blocks // len(frames)
        names[mine] = [f"{n}#{b}" for n, b in zip(names[mine], block, strict=True)]
    return names.astype(str)
