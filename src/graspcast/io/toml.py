"""Reading a table of a TOML file key by key, with errors that say where."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from graspcast.errors import FormatError, UnknownNameError

__all__ = ["TomlTable", "read_toml"]


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file.

    Raises
    ------
    FormatError
        If it cannot be read, or is not TOML.
    """
    try:
        with path.open("rb") as stream:
            return tomllib.load(stream)
    except OSError as error:
        raise FormatError(path, f"cannot be read ({error.strerror})") from error
    except ValueError as error:  # bad TOML or bad UTF-8
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
    """One table, read key by key; what is left over at the end is an error.

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
        """The error to raise for a key; ``problem`` follows its name."""
        return FormatError(self.path, f"{key} {problem}", where=self.where)

    def take(self, key: str, kind: type, default: Any = _REQUIRED) -> Any:
        """A value of a type; a whole number will do for a float.

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
            return float(value)
        if not isinstance(value, kind) or (kind is not bool and isinstance(value, bool)):
            raise self.error(key, f"should be {_IN_WORDS[kind]}, not {value!r}")
        return value

    def number(self, key: str, holds: Callable[[float], bool], condition: str) -> float:
        """A finite number for which ``holds`` is true; ``condition`` says so in words."""
        value = float(self.take(key, float))
        if not (np.isfinite(value) and holds(value)):
            raise self.error(key, f"is {value}, and must be finite and {condition}")
        return value

    def numbers(
        self, key: str, count: int, default: tuple[float, ...] | Any = _REQUIRED
    ) -> list[float]:
        """A list of so many finite numbers."""
        values = list(self.take(key, list, default))
        numeric = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
        if len(values) != count or not numeric or not np.isfinite(values).all():
            raise self.error(key, f"should be {count} finite numbers, not {values}")
        return [float(v) for v in values]

    def nothing_else(self) -> None:
        """Raise FormatError for the first key that nobody has asked for."""
        if unknown := sorted(set(self.values) - set(self._known)):
            error = UnknownNameError("key", unknown[0], self._known)
            raise FormatError(self.path, str(error), where=self.where)
