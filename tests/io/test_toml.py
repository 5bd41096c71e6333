"""TOML tables read key by key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from graspcast.errors import FormatError
from graspcast.io.toml import TomlTable, read_toml

TABLE = {"name": "mug", "mass": 1, "size": [1, 2.5, 3], "open": True}


@pytest.fixture
def mug(tmp_path: Path) -> TomlTable:
    path = tmp_path / "a.toml"
    path.write_text('name = "mug"\nmass = 1\nsize = [1, 2.5, 3]\nopen = true\n')
    assert read_toml(path) == TABLE
    return TomlTable(path, "[mug]", read_toml(path))


def test_values_by_type(mug: TomlTable) -> None:
    assert mug.take("name", str) == "mug"
    assert isinstance(mug.take("mass", float), float)
    assert mug.take("open", bool) is True
    assert mug.take("colour", str, "red") == "red"
    assert mug.numbers("size", 3) == [1.0, 2.5, 3.0]
    assert mug.number("mass", lambda m: m > 0, "positive") == 1.0
    mug.nothing_else()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("take", "mass", str), "mass should be text, not 1"),
        (("take", "open", int), "open should be a whole number, not True"),
        (("take", "colour", str), "colour is missing"),
        (("number", "mass", lambda m: m > 2, "over 2"), "mass is 1.0, and must be finite and over"),
        (("numbers", "size", 4), "size should be 4 finite numbers"),
        (("numbers", "name", 3), "name should be a list"),
        (("nothing_else",), "unknown key 'mass'"),
    ],
)
def test_errors_name_table_and_key(
    mug: TomlTable, arguments: tuple[Any, ...], message: str
) -> None:
    method, *rest = arguments
    with pytest.raises(FormatError, match=message) as caught:
        getattr(mug, method)(*rest)
    assert "a.toml, [mug]: " in str(caught.value)


@pytest.mark.parametrize("content", [b"[mug", b"\xff\xfe = 1"])
def test_a_file_that_is_not_toml(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.toml").write_bytes(content)
    with pytest.raises(FormatError, match=r"is not TOML|is not UTF-8"):
        read_toml(tmp_path / "a.toml")
    with pytest.raises(FormatError, match="cannot be read"):
        read_toml(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a = " + 500 * "[" + 500 * "]", "nested too deeply"),
        ("a = " + 5000 * "9", "is not TOML"),
    ],
)
def test_files_that_cannot_be_parsed_are_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(FormatError, match=says):
        read_toml(tmp_path / "a.toml")


def test_numbers_too_large_for_a_float_are_refused() -> None:
    table = TomlTable(Path("a.toml"), "t", {"x": 10**400, "v": [0, 10**400]})
    with pytest.raises(FormatError, match="x is too large a number"):
        table.take("x", float)
    with pytest.raises(FormatError, match="v is too large a number"):
        table.numbers("v", 2)


def test_what_should_be_a_table_and_numbers_that_are_infinite_are_refused() -> None:
    with pytest.raises(FormatError, match=r"a\.toml, grasp\[0\]: should be a table, not 'top'"):
        TomlTable(Path("a.toml"), "grasp[0]", "top")
    table = TomlTable(Path("a.toml"), "t", {"v": [0.0, float("inf")]})
    with pytest.raises(FormatError, match="v should be 2 finite numbers"):
        table.numbers("v", 2)
