"""TOML files, read key by key, with errors that name the file and the table."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from graspcast.errors import FormatError, UnknownNameError
from graspcast.io.reading import MAX_TEXT_BYTES, read_text

__all__ = ["TomlTable", "read_toml"]


def read_toml(path: Path) -> dict[str, Any]:
    """Parse a TOML file.

    Raises
    ------
    FormatError
        If it cannot be read, or is not TOML.
    """
    try:
        return tomllib.loads(read_text(path, MAX_TEXT_BYTES))
    except RecursionError as error:
        raise FormatError(path, "is nested too deeply") from error
    except ValueError as error:
        raise FormatError(path, f"is not TOML ({error})") from error


_IN_WORDS = {
    str: "text",
    float: "a number",
    int: "a whole number",
    list: "a list",
    dict: "a table",
    bool: "true or false",
}

_REQUIRED: Any = object()


class TomlTable:
    """A table of a TOML file, read key by key.

    Parameters
    ----------
    path
        The file, for messages.
    where
        The table's name in the file.
    values
        Its content.
    """

    def __init__(self, path: Path, where: str, values: Any):
        self.path, self.where = path, where
        if not isinstance(values, dict):
            raise FormatError(path, f"should be a table, not {values!r}", where=where)
        self.values = values
        self._known: list[str] = []

    def error(self, key: str, problem: str) -> FormatError:
        """Return the error to raise for a key; ``problem`` follows the key's name."""
        return FormatError(self.path, f"{key} {problem}", where=self.where)

    def take(self, key: str, kind: type, default: Any = _REQUIRED) -> Any:
        """Return a value of a type; where a float is wanted, an int is converted.

        Raises
        ------
        FormatError
            If it is missing and there is no default, or of another type.
        """
        self._known.append(key)
        if key not in self.values:
            if default is _REQUIRED:
                raise self.error(key, "is missing")
            return default
        value = self.values[key]
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            return self._float(key, value)
        if not isinstance(value, kind) or (kind is not bool and isinstance(value, bool)):
            raise self.error(key, f"should be {_IN_WORDS[kind]}, not {value!r}")
        return value

    def number(self, key: str, holds: Callable[[float], bool], condition: str) -> float:
        """Return a finite number that meets a condition.

        Parameters
        ----------
        key
            The number's key.
        holds
            The condition.
        condition
            The condition in words, for the message: ``"positive"``.

        Raises
        ------
        FormatError
            If it is missing, of another type, not finite, or does not meet the condition.
        """
        value = float(self.take(key, float))
        if not (np.isfinite(value) and holds(value)):
            raise self.error(key, f"is {value}, and must be finite and {condition}")
        return value

    def numbers(
        self, key: str, count: int, default: tuple[float, ...] | Any = _REQUIRED
    ) -> list[float]:
        """Return a list of ``count`` finite numbers.

        Raises
        ------
        FormatError
            If it is something else.
        """
        values = list(self.take(key, list, default))
        numeric = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
        if len(values) != count or not numeric:
            raise self.error(key, f"should be {count} finite numbers, not {values}")
        found = [self._float(key, v) for v in values]
        if not np.isfinite(found).all():
            raise self.error(key, f"should be {count} finite numbers, not {values}")
        return found

    def _float(self, key: str, value: int | float) -> float:
        try:
            return float(value)
        except OverflowError as error:
            raise self.error(key, "is too large a number") from error

    def nothing_else(self) -> None:
        """Check that no key is left over.

        Raises
        ------
        FormatError
            For the first key that has not been read.
        """
        if unknown := sorted(set(self.values) - set(self._known)):
            error = UnknownNameError("key", unknown[0], self._known)
            raise FormatError(self.path, str(error), where=self.where)
