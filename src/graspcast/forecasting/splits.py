"""TODO."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Int
from numpy import ndarray

from graspcast.errors import MismatchError
from graspcast.estimates.instances import scene_groups
from graspcast.forecasting.samples import Samples

__all__ = [
    "VALIDATION_SHARE",
    "Fold",
    "by_object",
    "by_scene",
    "validation_part",
]


VALIDATION_SHARE = 0.2


Fold = tuple[Int[ndarray, "train"], Int[ndarray, "test"]]


def by_scene(
    samples: Samples, *, folds: int = 5, seed: int = 0, groups: ndarray | None = None
) -> Iterator[Fold]:
    """Cross-validation in which no scene (or block of frames) is on both sides.

    Parameters
    ----------
    samples
        What is dealt out.
    folds
        How many parts.
    seed
        Of the dealing.
    groups
        What is kept together, (n,), if not :func:`scene_groups` of the samples.

    Raises
    ------
    MismatchError
        If there are fewer scenes than folds.
    """
    from sklearn.model_selection import StratifiedGroupKFold

    groups = scene_groups(samples.estimates.instances) if groups is None else groups
    if (count := len(np.unique(groups))) < folds:
        raise MismatchError(f"{count} scenes cannot make {folds} folds; ask for fewer folds")
    splitter = StratifiedGroupKFold(n_splits=folds, shuffle=True, random_state=seed)
    # Objects too should be spread evenly, so they are part of what is stratified.
    names = [f"{o}:{s}" for o, s in zip(samples.objects, samples.success, strict=True)]
    _, strata, sizes = np.unique(names, return_inverse=True, return_counts=True)
    # What is rarer than the folds cannot be spread over them, and scikit-learn would not have it.
    rare = sizes[strata] < folds
    strata[rare] = -1 if rare.sum() >= folds else np.argmax(sizes)
    yield from splitter.split(np.zeros(len(samples)), strata, groups)


def by_object(samples: Samples) -> Iterator[tuple[str, Fold]]:
    """Each object left out in turn: its name, and (train, test)."""
    objects = samples.objects
    for name in np.unique(objects):
        yield str(name), (np.flatnonzero(objects != name), np.flatnonzero(objects == name))


def validation_part(
    strata: ndarray, seed: int, *, share: float = VALIDATION_SHARE
) -> Bool[ndarray, "n"]:
    """A random part of the samples for validation, the same share of each stratum, (n,) mask."""
    out = np.zeros(len(strata), dtype=bool)
    rng = np.random.default_rng(seed)
    for value in np.unique(strata):
        mine = rng.permutation(np.flatnonzero(strata == value))
        out[mine[: round(share * len(mine))]] = True
    return out
