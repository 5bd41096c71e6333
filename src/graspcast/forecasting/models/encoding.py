"""TODO."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.errors import UnknownNameError

__all__ = ["UNSEEN", "one_hot", "one_hot_numbers"]


def one_hot(names: Iterable[str], known: tuple[str, ...], kind: str) -> Float[ndarray, "n k"]:
    """A row for each name, with a 1 at its place among the known ones.

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


def one_hot_numbers(numbers: Int[ndarray, "n"], count: int) -> Float[ndarray, "n count"]:
    """A one for the object of each row; for an unseen one, which is none of them, zeros."""
    return np.concatenate([np.eye(count), np.zeros((1, count))])[numbers]
