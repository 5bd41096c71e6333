"""Reading JSON files of others, with messages that name the file and the place in it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import FormatError

__all__ = ["identifier", "numbers", "read_json", "require"]


def read_json(path: str | PathLike[str], kind: type[object]) -> Any:
    """Parse a JSON file whose top level must be a ``kind`` (dict or list).

    Raises
    ------
    FormatError
        If it cannot be read or parsed, or holds something else.
    """
    try:
        value = json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise FormatError(path, f"cannot be read ({error.strerror})") from error
    except RecursionError as error:
        raise FormatError(path, "is nested too deeply") from error
    except ValueError as error:  # json.JSONDecodeError, UnicodeDecodeError and too-long integers
        raise FormatError(path, f"is not valid JSON ({error})") from error
    if not isinstance(value, kind):
        name = "an object" if kind is dict else "a list"
        raise FormatError(path, f"should hold {name} at its top level")
    return value


def require(entry: Any, key: str, path: str | PathLike[str], where: str) -> Any:
    """``entry[key]``, or a FormatError that lists the keys there are."""
    if not isinstance(entry, dict):
        raise FormatError(path, "should be an object", where=where)
    if key not in entry:
        raise FormatError(path, f"no {key!r}; found {', '.join(entry) or 'nothing'}", where=where)
    return entry[key]


def identifier(value: Any, path: str | PathLike[str], where: str) -> int:
    """A BOP number (a whole number, 0 or more), given as a number or as a key's text."""
    try:
        if isinstance(value, bool | float):
            raise ValueError
        number = int(value)
        if not 0 <= number < 2**31:
            raise ValueError
    except (TypeError, ValueError) as error:
        raise FormatError(
            path, f"{value!r} is not a whole number, 0 or more", where=where
        ) from error
    return number


def numbers(
    value: Any, shape: Sequence[int], path: str | PathLike[str], where: str
) -> Float[ndarray, "..."]:
    """A list of finite numbers, reshaped; or a FormatError."""
    try:
        array = np.array(value, dtype=np.float64)
        if array.size != np.prod(shape) or not np.isfinite(array).all():
            raise ValueError
        return array.reshape(tuple(shape))
    except (TypeError, ValueError, OverflowError) as error:
        count = int(np.prod(shape))
        raise FormatError(
            path, f"should be {count} finite number{'s' if count > 1 else ''}", where=where
        ) from error
