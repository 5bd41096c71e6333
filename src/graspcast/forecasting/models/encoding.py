"""One-hot encoding of objects and grippers."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.errors import UnknownNameError

__all__ = ["UNSEEN", "one_hot", "one_hot_numbers"]


def one_hot(names: Iterable[str], known: tuple[str, ...], kind: str) -> Float[ndarray, "n k"]:
    """Encode names as one-hot rows over the known names.

    Raises
    ------
    UnknownNameError
        For a name that is not known.
    """
    place = {name: i for i, name in enumerate(known)}
    names = list(names)
    for name in names:
        if name not in place:
            raise UnknownNameError(kind, name, known)
    return np.eye(len(known))[[place[name] for name in names]]


UNSEEN = -1
"""The number of an object that was not trained on."""


def one_hot_numbers(numbers: Int[ndarray, " n"], count: int) -> Float[ndarray, "n count"]:
    """Encode object numbers as one-hot rows; an unseen object (-1) is a row of zeros."""
    return np.asarray(numbers[:, None] == np.arange(count), dtype=np.float64)
