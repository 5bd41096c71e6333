"""Names of members: unsafe ones, and collisions."""

from __future__ import annotations

import pytest

from graspcast.fetching.member_names import Names, UnsafeNameError, parts_of


def test_a_name() -> None:
    assert parts_of("models/./obj_000001.ply") == ("models", "obj_000001.ply")
    assert parts_of("models/") == ("models",)
    assert parts_of("Größe/.hidden") == ("Größe", ".hidden")


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("/etc/passwd", "absolute"),
        ("//host/share/x", "absolute"),
        ("../x", "leads out"),
        ("a/../../x", "leads out"),
        ("", "is no name"),
        ("./", "is no name"),
        ("C:/x", "':'"),
        ("a\\..\\x", "forbid"),
        ("a\0b", "forbid"),
        ("a\nb", "forbid"),
        ("a*", "forbid"),
        ("models/NUL", "device on Windows"),
        ("models/com1.ply", "device on Windows"),
        ("aux .txt", "device on Windows"),
        ("models/x.", "ends with a dot"),
        ("models /x", "a space"),
        ("x" * 300, "too long"),
        ("a/" * 40 + "x", "too deep"),
        ("\udcff", "not valid Unicode"),
    ],
)
def test_unsafe_names(name: str, says: str) -> None:
    with pytest.raises(UnsafeNameError, match=says):
        parts_of(name)


@pytest.mark.parametrize(
    ("first", "second", "says"),
    [
        ("a/b", "a/b", "there twice"),
        ("a/b", "a/B", "same as 'a/b'"),
        ("a/b", "A/c", "same as 'a'"),
        ("\u00e9", "e\u0301", "same as"),
        ("straße", "STRASSE", "same as"),
        ("a", "a/b", "both a file and a folder"),
        ("a/b", "a", "both a file and a folder"),
    ],
)
def test_collisions(first: str, second: str, says: str) -> None:
    names = Names()
    names.add(parts_of(first), folder=False)
    with pytest.raises(UnsafeNameError, match=says):
        names.add(parts_of(second), folder=False)


def test_folders_may_be_named_again() -> None:
    names = Names()
    names.add(("a", "b"), folder=False)
    names.add(("a",), folder=True)
    names.add(("a",), folder=True)
    names.add((), folder=True)
