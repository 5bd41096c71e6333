"""Splits for cross-validation and validation.

Frames of a scene are a video, so a random split puts nearly equal images on both sides. These
splits assign whole groups (:func:`graspcast.estimates.instances.scene_groups`: scenes, or
contiguous blocks of frames of a dataset's only scene) to one side.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Int
from numpy import ndarray

from graspcast.errors import MismatchError

__all__ = [
    "VALIDATION_SHARE",
    "Fold",
    "by_group",
    "by_object",
    "fold_numbers",
    "validation_mask",
]


VALIDATION_SHARE = 0.2
"""Share of the training data that is used for validation."""

Fold = tuple[Int[ndarray, " train"], Int[ndarray, " test"]]
"""Row numbers of the training and of the test instances."""


def by_group(
    groups: ndarray,
    objects: ndarray,
    success: Bool[ndarray, " n"] | None = None,
    *,
    folds: int = 5,
    seed: int = 0,
) -> Iterator[Fold]:
    """Yield cross-validation folds that keep groups together (stratified group k-fold).

    Parameters
    ----------
    groups
        Group of each instance, (n,).
    objects
        ``dataset-number`` of each instance's object, (n,); objects are spread evenly over folds.
    success
        Outcomes, which are spread evenly too, (n,); None ignores outcomes.
    folds
        Number of folds.
    seed
        Of the assignment of groups to folds.

    Raises
    ------
    MismatchError
        If there are fewer groups than folds.
    """
    from sklearn.model_selection import StratifiedGroupKFold

    if (count := len(np.unique(groups))) < folds:
        raise MismatchError(
            f"{count} scenes cannot make {folds} folds; ask for fewer folds", parameters=("folds",)
        )
    if success is None:
        success = np.zeros(len(groups), dtype=bool)
    splitter = StratifiedGroupKFold(n_splits=folds, shuffle=True, random_state=seed)
    names = [f"{o}:{s}" for o, s in zip(objects, success, strict=True)]
    _, strata, sizes = np.unique(names, return_inverse=True, return_counts=True)
    # scikit-learn refuses strata with fewer instances than folds, so these are merged.
    rare = sizes[strata] < folds
    strata[rare] = -1 if rare.sum() >= folds else np.argmax(sizes)
    yield from splitter.split(np.zeros(len(groups)), strata, groups)


def by_object(objects: ndarray) -> Iterator[Fold]:
    """Yield folds that leave out each object in turn, in the order of their names."""
    for name in np.unique(objects):
        yield np.flatnonzero(objects != name), np.flatnonzero(objects == name)


def fold_numbers(groups: ndarray, folds: int, *, seed: int | None = None) -> Int[ndarray, " n"]:
    """Assign whole groups to folds of equally many groups; the fold of each instance.

    Parameters
    ----------
    groups
        Group of each instance, (n,).
    folds
        Number of folds; at most as many as there are groups are used.
    seed
        Of a random assignment; None assigns groups in turn, in the order of their names.
    """
    names, group = np.unique(groups, return_inverse=True)
    number = np.arange(len(names))
    if seed is not None:
        number = np.random.default_rng(seed).permutation(len(names))
    return (number % min(folds, len(names)))[group]


def validation_mask(
    strata: ndarray, seed: int, *, share: float = VALIDATION_SHARE
) -> Bool[ndarray, " n"]:
    """Choose a random validation set, the same share of each stratum; a mask, (n,)."""
    out = np.zeros(len(strata), dtype=bool)
    rng = np.random.default_rng(seed)
    for value in np.unique(strata):
        mine = rng.permutation(np.flatnonzero(strata == value))
        out[mine[: round(share * len(mine))]] = True
    return out
