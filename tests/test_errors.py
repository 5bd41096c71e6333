"""The errors: one tree, stated in one place; messages that help."""

from __future__ import annotations

import importlib
import inspect
import pkgutil

import pytest

import graspcast
from graspcast import errors
from graspcast.errors import (
    ExtraMissingError,
    FormatError,
    GraspcastError,
    InputError,
    MismatchError,
    UnknownNameError,
)


def every_error() -> set[type[GraspcastError]]:
    for info in pkgutil.walk_packages(graspcast.__path__, "graspcast."):
        if info.name.endswith("__main__"):
            continue
        try:
            importlib.import_module(info.name)
        except ModuleNotFoundError as error:
            if error.name not in ("torch", "onnx"):  # of the extra train
                raise
    found: set[type[GraspcastError]] = {GraspcastError}
    waiting = [GraspcastError]
    while waiting:
        children = waiting.pop().__subclasses__()
        found.update(children)
        waiting.extend(children)
    return {error for error in found if error.__module__.startswith("graspcast")}


def test_every_error_is_listed_and_in_the_tree() -> None:
    raised = {name for name in errors.__all__ if not issubclass(getattr(errors, name), Warning)}
    assert {error.__name__ for error in every_error()} == raised
    branch: dict[int, str] = {}
    parents = {}
    for line in (errors.__doc__ or "").splitlines():
        words = line.replace("│", " ").replace("├──", "   ").replace("└──", "   ")
        name = words.split()[0] if words.strip() else ""
        if name.endswith("Error"):
            depth = len(words) - len(words.lstrip())
            branch = {d: n for d, n in branch.items() if d < depth} | {depth: name}
            parents[name] = branch[max(d for d in branch if d < depth)] if len(branch) > 1 else None
    assert parents == {
        error.__name__: error.__base__.__name__ if error is not GraspcastError else None  # type: ignore[union-attr]
        for error in every_error()
    }


def test_all_have_a_docstring() -> None:
    for error in every_error():
        assert inspect.getdoc(error), error


def test_a_format_error_names_the_file_and_the_place() -> None:
    error = FormatError("a/b.csv", "t should be three numbers", where="line 7")
    assert str(error) == "a/b.csv, line 7: t should be three numbers"
    assert (error.path, error.problem, error.where) == (
        "a/b.csv",
        "t should be three numbers",
        "line 7",
    )
    assert str(FormatError("b.csv", "is empty")) == "b.csv: is empty"


def test_an_unknown_name_lists_the_known_ones() -> None:
    error = UnknownNameError("gripper", "paralel", ["parallel", "hand"], hint="These are built in")
    assert str(error) == (
        "unknown gripper 'paralel' (did you mean 'parallel'?); known: parallel, hand. "
        "These are built in"
    )
    assert str(UnknownNameError("object", 7, [1, 5])) == "unknown object '7'; known: 1, 5"
    assert str(UnknownNameError("object", 7, [])) == "unknown object '7'; known: none"


def test_a_missing_extra_has_the_line_to_type() -> None:
    with pytest.raises(GraspcastError, match=r"pip install 'graspcast\[render\]'"):
        raise ExtraMissingError("pillow", "render")


def test_what_came_from_outside_is_caught_as_one() -> None:
    for error in (FormatError, UnknownNameError, MismatchError):
        assert issubclass(error, InputError)
    assert not issubclass(ExtraMissingError, InputError)
