"""JSON files: what is written comes back, and errors name the file and the place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.errors import FormatError, InputError
from graspcast.io.json import by_identifier, identifier, numbers, read_json, require, write_json

scalars = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.text()
    | st.floats(allow_nan=False, allow_infinity=False)
)
values = st.recursive(
    scalars, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=10
)


@given(st.lists(values) | st.dictionaries(st.text(), values), st.booleans())
def test_content_comes_back(
    tmp_path_factory: pytest.TempPathFactory, content: Any, one_entry_a_line: bool
) -> None:
    path = tmp_path_factory.mktemp("json") / "a.json"
    write_json(path, content, one_entry_a_line=one_entry_a_line)
    assert read_json(path, type(content)) == content


def test_layouts(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_json(path, {"1": [1, 2], "2": {}}, one_entry_a_line=True)
    assert path.read_text() == '{\n  "1": [1, 2],\n  "2": {}\n}\n'
    write_json(path, [{"a": 1}, 2], one_entry_a_line=True)
    assert path.read_text() == '[\n  {"a": 1},\n  2\n]\n'
    write_json(path, [], one_entry_a_line=True)
    assert path.read_text() == "[]\n"
    write_json(path, {"a": [1]})
    assert path.read_text() == json.dumps({"a": [1]}, indent=2) + "\n"


@pytest.mark.parametrize("one_entry_a_line", [False, True])
@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_a_number_that_is_not_finite_is_refused_and_the_old_file_stays(
    tmp_path: Path, number: float, one_entry_a_line: bool
) -> None:
    path = tmp_path / "a.json"
    path.write_text("old")
    with pytest.raises(InputError, match=r"a\.json: holds a number that is not finite"):
        write_json(path, {"a": [number]}, one_entry_a_line=one_entry_a_line)
    assert path.read_text() == "old"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not valid JSON"),
        ("[]", "should hold an object at its top level"),
        ("[" * 100_000, "is nested too deeply"),
    ],
)
def test_damaged_files(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(FormatError, match=message):
        read_json(path, dict)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"none\.json: cannot be read"):
        read_json(tmp_path / "none.json", dict)


def test_a_missing_key_is_named_with_those_there_are() -> None:
    assert require({"a": 1}, "a", "f", "top") == 1
    with pytest.raises(FormatError, match="f, top: no 'b'; found a, c"):
        require({"a": 1, "c": 2}, "b", "f", "top")
    with pytest.raises(FormatError, match="should be an object"):
        require([1], "b", "f", "top")


@pytest.mark.parametrize("value", [-1, 1.0, True, "x", None, 2**31, "1.5"])
def test_what_is_no_identifier(value: object) -> None:
    with pytest.raises(FormatError, match="is not a whole number, 0 or more"):
        identifier(value, "f", "here")


def test_identifiers() -> None:
    assert [identifier(v, "f", "here") for v in (0, "000012", 7)] == [0, 12, 7]


@pytest.mark.parametrize("value", [[1, 2], [1, 2, float("nan")], ["a", "b", "c"], None, {}])
def test_what_are_no_three_numbers(value: object) -> None:
    with pytest.raises(FormatError, match="should be 3 finite numbers"):
        numbers(value, (3,), "f", "here")


def test_numbers_are_reshaped() -> None:
    assert numbers([1, 2, 3, 4], (2, 2), "f", "here").tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize("text", ['{"a": 1, "a": 1}', '[{"b": {"a": 1, "x": 0, "a": 2}}]'])
def test_a_key_that_comes_twice_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(FormatError, match="has the key 'a' twice in one object"):
        read_json(tmp_path / "a.json", object)


def test_two_spellings_of_one_id_are_refused() -> None:
    assert list(by_identifier({"2": "x", "01": "y"}, "f", "image")) == [
        (2, "2", "x"),
        (1, "01", "y"),
    ]
    with pytest.raises(FormatError, match="the keys '0' and '00' are the same image"):
        list(by_identifier({"0": 1, "00": 2}, "f.json", "image"))
    with pytest.raises(FormatError, match="image x: 'x' is not a whole number"):
        list(by_identifier({"x": 1}, "f.json", "image"))
