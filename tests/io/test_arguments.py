"""What is of the wrong kind is refused by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from graspcast.errors import InputError
from graspcast.io.arguments import NAME, PATH, a, checked, mapping, number, sequence


@checked(path=PATH, share=number(0.0, 1.0), name=NAME)
def ask(path: object, share: object = 0.5, *, name: object = None) -> tuple[object, ...]:
    return path, share, name


@checked(value=number(), threshold=number())
class Asked:
    def method(self, value: object, threshold: object = 0.5) -> object:
        return value, threshold

    @classmethod
    def of(cls, value: object) -> object:
        return cls, value


def test_right_kinds_pass_and_none_where_it_is_the_default() -> None:
    assert ask("a") == ("a", 0.5, None)
    assert ask(Path("a"), np.float32(1), name="b") == (Path("a"), 1, "b")
    assert Asked().method(3, None) == (3, None)
    assert Asked.of(3) == (Asked, 3)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (([],), r"ask: path should be a path, not list"),
        ((None,), "path should be a path, not NoneType"),
        (("a", 1.5), "share should be a number from 0 to 1, not 1.5"),
        (("a", "x"), "share should be a number from 0 to 1, not 'x'"),
        (("a", True), "not True"),
        (("a", float("nan")), "not nan"),
        (("a", 10**400), "share should be a number"),
        (("a", None), "not NoneType"),
    ],
)
def test_wrong_kinds_are_named(arguments: tuple[object, ...], says: str) -> None:
    with pytest.raises(InputError, match=says) as raised:
        ask(*arguments)
    assert raised.value.parameters in (("path",), ("share",))


def test_methods_are_checked_too() -> None:
    with pytest.raises(InputError, match=r"Asked\.method: value should be a number, not 'x'"):
        Asked().method("x")
    with pytest.raises(InputError, match=r"Asked\.of: value should be a number, not dict of int"):
        Asked.of({"a": 1})


def test_mappings_and_lists_are_checked_inside() -> None:
    for good in ({}, {"a": 1.0}):
        assert mapping(number())[0](good)
    for bad in ([], {1: 1.0}, {"a": "x"}, None):
        assert not mapping(number())[0](bad)
    assert sequence(a(str))[0](["a"]) and not sequence(a(str))[0]("a")
    assert "a list of what is of type str" in sequence(a(str))[1]


def test_a_wrong_number_of_arguments_stays_a_type_error() -> None:
    with pytest.raises(TypeError, match="unexpected"):
        ask("a", other=1)


def test_arguments_are_found_in_every_place() -> None:
    @checked(name=NAME, size=number(0.0))
    def made(name: str, /, *rest: int, size: float = 1.0) -> str:
        return name

    assert made("a", 1, 2, size=3) == "a"
    for wrong in (lambda: made(1), lambda: made("a", 1, size=-1)):  # type: ignore[arg-type]
        with pytest.raises(InputError):
            wrong()


def test_a_class_is_named_without_its_constructor() -> None:
    @checked(value=number())
    class Made:
        @checked(value=number())
        def __init__(self, value: object):
            self.value = value

    with pytest.raises(InputError, match=r"\bMade: value should be a number, not 'x'") as caught:
        Made("x")
    assert "__init__" not in str(caught.value)
