"""JSON files: reading with errors that name the file and the place in it, and atomic writes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import FormatError, InputError
from graspcast.io.files import write_text
from graspcast.io.numerals import plain
from graspcast.io.reading import read_text

__all__ = ["by_identifier", "identifier", "numbers", "read_json", "require", "write_json"]


def read_json(path: str | PathLike[str], kind: type[object]) -> Any:
    """Parse a JSON file whose top level must be a ``kind`` (dict or list).

    Raises
    ------
    FormatError
        If it cannot be read or parsed, or its top level is something else.
    """
    try:
        value = json.loads(read_text(path), object_pairs_hook=_without_repeats)
    except RecursionError as error:
        raise FormatError(path, "is nested too deeply") from error
    except _RepeatedKeyError as error:
        raise FormatError(path, f"has the key {str(error)!r} twice in one object") from error
    except ValueError as error:  # json.JSONDecodeError, and too-long integers
        raise FormatError(path, f"is not valid JSON ({error})") from error
    if not isinstance(value, kind):
        name = "an object" if kind is dict else "a list"
        raise FormatError(path, f"should hold {name} at its top level")
    return value


class _RepeatedKeyError(Exception):
    pass


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    out = dict(pairs)
    if len(out) < len(pairs):
        keys = [key for key, _ in pairs]
        raise _RepeatedKeyError(next(key for key in keys if keys.count(key) > 1))
    return out


def write_json(
    path: str | PathLike[str], content: Any, *, indent: int = 2, one_entry_a_line: bool = False
) -> None:
    """Write a value as JSON, atomically.

    Parameters
    ----------
    path
        The file.
    content
        Dicts, lists, texts, booleans, None, and finite numbers.
    indent
        Spaces an indentation level.
    one_entry_a_line
        Put each entry of the top level, a dict or a list, on one line, as BOP's files have it.

    Raises
    ------
    InputError
        If a number is NaN or infinite, or the file cannot be written.
    """
    try:
        if not one_entry_a_line:
            text = json.dumps(content, indent=indent, allow_nan=False)
        elif isinstance(content, dict):
            entries = [f"{json.dumps(k)}: {_dumps(v)}" for k, v in content.items()]
            text = f"{{{_lines(entries)}}}"
        else:
            text = f"[{_lines([_dumps(v) for v in content])}]"
    except ValueError as error:
        raise InputError(f"{path}: holds a number that is not finite") from error
    write_text(path, text + "\n")


def _dumps(value: Any) -> str:
    return json.dumps(value, allow_nan=False)


def _lines(entries: Sequence[str]) -> str:
    return "\n  " + ",\n  ".join(entries) + "\n" if entries else ""


def require(entry: Any, key: str, path: str | PathLike[str], where: str) -> Any:
    """Return ``entry[key]``.

    Raises
    ------
    FormatError
        If ``entry`` is no dict, or lacks the key; the message lists its keys.
    """
    if not isinstance(entry, dict):
        raise FormatError(path, "should be an object", where=where)
    if key not in entry:
        raise FormatError(path, f"no {key!r}; found {', '.join(entry) or 'nothing'}", where=where)
    return entry[key]


def identifier(value: Any, path: str | PathLike[str], where: str) -> int:
    """Parse a BOP id: a whole number, 0 or more, given as a number or as text.

    Raises
    ------
    FormatError
        If it is something else.
    """
    try:
        if isinstance(value, bool | float):
            raise ValueError
        number = int(plain(value))
        if not 0 <= number < 2**31:
            raise ValueError
    except (TypeError, ValueError) as error:
        raise FormatError(
            path, f"{value!r} is not a whole number, 0 or more", where=where
        ) from error
    return number


def by_identifier(
    content: Mapping[str, Any], path: str | PathLike[str], what: str
) -> Iterator[tuple[int, str, Any]]:
    """Yield the id, the key and the value of each entry of an object whose keys are BOP ids.

    Parameters
    ----------
    content
        The object.
    path
        The file, for messages.
    what
        What the ids are of, for messages.

    Raises
    ------
    FormatError
        For a key that is no id, or two keys of one id (``"0"`` and ``"00"``).
    """
    keys: dict[int, str] = {}
    for key, value in content.items():
        number = identifier(key, path, f"{what} {key}")
        if (first := keys.setdefault(number, key)) != key:
            raise FormatError(path, f"the keys {first!r} and {key!r} are the same {what}")
        yield number, key, value


def numbers(
    value: Any, shape: Sequence[int], path: str | PathLike[str], where: str
) -> Float[ndarray, "..."]:
    """Convert a list of finite numbers to an array of a given shape.

    Raises
    ------
    FormatError
        If it holds something else, or another number of them.
    """
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
