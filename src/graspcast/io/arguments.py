"""Arguments of public functions: what is of the wrong kind is refused where it comes in.

Wrong kinds are a user's mistakes like any other, and are told as such, by name, instead of failing
somewhere inside.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from numbers import Integral, Real
from os import PathLike
from typing import Any, TypeVar

from graspcast.errors import InputError

__all__ = [
    "FLAG",
    "NAME",
    "NAMED",
    "PATH",
    "Kind",
    "a",
    "checked",
    "mapping",
    "number",
    "refuse_unless",
    "sequence",
    "whole",
]

T = TypeVar("T")
Kind = tuple[Callable[[Any], bool], str]
"""What an argument has to be: a test, and words for it."""


def a(*classes: type, words: str = "") -> Kind:
    """Return the kind of instances of some classes."""
    names = " or ".join(c.__name__ for c in classes)
    return lambda value: isinstance(value, classes), words or f"of type {names}"


def number(low: float = float("-inf"), high: float = float("inf")) -> Kind:
    """Return the kind of real numbers in a closed range."""

    def test(value: Any) -> bool:
        if type(value) is bool or not isinstance(value, Real):
            return False
        try:
            return low <= float(value) <= high
        except OverflowError:  # a whole number that no float can hold
            return False

    return test, f"a number from {low:g} to {high:g}" if high < float("inf") else "a number"


def mapping(of: Kind, keys: str = "name") -> Kind:
    """Return the kind of mappings from text to values of a kind."""
    test, words = of

    def every(value: Any) -> bool:
        return isinstance(value, Mapping) and all(
            isinstance(key, str) and test(entry) for key, entry in value.items()
        )

    return every, f"a mapping, such as a dict, of {keys} (text) to what is {words}"


def sequence(of: Kind) -> Kind:
    """Return the kind of lists and tuples of a kind."""
    test, words = of
    return (
        lambda value: isinstance(value, list | tuple) and all(map(test, value)),
        f"a list of what is {words}",
    )


def whole(low: int = -(2**63)) -> Kind:
    """Return the kind of whole numbers of 64 bits from a lowest one on."""

    def test(value: Any) -> bool:
        if isinstance(value, bool) or not isinstance(value, Integral):
            return False
        return low <= int(value) < 2**63

    return test, "a whole number" + (f", {low} or more" if low >= 0 else "")


def _is_flag(value: Any) -> bool:
    return type(value).__name__ in ("bool", "bool_") or (
        isinstance(value, Real) and value in (0, 1)
    )


FLAG: Kind = (_is_flag, "true or false")
PATH = a(str, PathLike, words="a path")
NAME = a(str, words="text")
NAMED = mapping((lambda value: True, "a pose or None"), "estimator")


def refuse_unless(kind: Kind, value: Any, where: str, parameter: str) -> None:
    """Raise if an argument is not of its kind.

    Raises
    ------
    InputError
        Naming function and parameter, what is expected, and what was given.
    """
    test, words = kind
    if not test(value):
        shown = repr(value) if isinstance(value, str | Real) else type(value).__name__
        if isinstance(value, Mapping):
            shown += f" of {', '.join(type(entry).__name__ for entry in value.values()) or 'none'}"
        shown = shown if len(shown) < 80 else f"{shown[:77]}…"
        raise InputError(
            f"{where}: {parameter} should be {words}, not {shown}", parameters=(parameter,)
        )


def checked(**kinds: Kind) -> Callable[[T], T]:
    """Return a decorator by which a function, or a class's public methods, check arguments.

    Parameters
    ----------
    kinds
        The kind of each parameter of that name; None passes where it is the default, and
        everywhere for ``threshold``, whose None attempts nothing.
    """

    def decorate(what: Any) -> Any:
        if not isinstance(what, type):
            return _wrapped(what, kinds)
        for name, value in list(vars(what).items()):
            if name.startswith("_"):
                continue
            if isinstance(value, classmethod):
                setattr(what, name, classmethod(_wrapped(value.__func__, kinds)))
            elif inspect.isfunction(value):
                setattr(what, name, _wrapped(value, kinds))
        return what

    return decorate


def _wrapped(function: Callable[..., Any], kinds: Mapping[str, Kind]) -> Callable[..., Any]:
    parameters = inspect.signature(function).parameters
    where = function.__qualname__.removesuffix(".__init__")
    mine = {name: kind for name, kind in kinds.items() if name in parameters}
    if not mine:
        return function
    optional = {n for n in mine if parameters[n].default is None or n == "threshold"}
    in_order = [
        n for n, p in parameters.items() if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)
    ]

    @wraps(function)
    def wrapper(*args: Any, **kwargs: Any) -> Any:
        given = dict(zip(in_order, args, strict=False), **kwargs)  # faster than Signature.bind
        for name, kind in mine.items():
            if name in given and not (given[name] is None and name in optional):
                refuse_unless(kind, given[name], where, name)
        return function(*args, **kwargs)

    return wrapper
