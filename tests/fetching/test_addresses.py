"""Addresses: mirrors, redirects, and what is shown of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from graspcast.errors import DownloadError, InputError
from graspcast.fetching.addresses import below, local_path, redirected, shown


def test_secrets_are_not_shown() -> None:
    assert shown("https://me:secret@host:8/a/b.zip?token=1#x") == "https://host:8/a/b.zip"
    assert shown("https://[::1]:8/a") == "https://[::1]:8/a"
    assert shown("https://[bad") == "an address that cannot be read"


@pytest.mark.parametrize(
    ("mirror", "url"),
    [
        ("https://host/data/", "https://host/data/a.zip"),
        ("HTTP://host", "http://host/a.zip"),
        ("https://host/data?key=1", "https://host/data/a.zip?key=1"),
        ("file:///data/mine", "file:///data/mine/a.zip"),
        ("/data/with space", "file:///data/with%20space/a.zip"),
    ],
)
def test_a_file_of_a_mirror(mirror: str, url: str) -> None:
    assert below(mirror, "a.zip") == url


@pytest.mark.parametrize("mirror", ["ftp://host/", "https://", "https://host:port/", "http://[x/"])
def test_what_is_no_mirror(mirror: str) -> None:
    with pytest.raises(InputError, match="the mirror") as caught:
        below(mirror, "a.zip")
    assert caught.value.parameters == ("mirror",)


def test_local_paths() -> None:
    assert local_path("file:///data/with%20space/a.zip") == Path("/data/with space/a.zip")
    assert local_path("https://host/a.zip") is None
    relative = below("here", "a.zip")
    assert local_path(relative) == Path("here").absolute() / "a.zip"


@pytest.mark.parametrize(
    ("url", "location", "target"),
    [
        ("https://a/b/c", "d", "https://a/b/d"),
        ("https://a/b", "//x/y", "https://x/y"),
        ("http://a/b", "https://a/b", "https://a/b"),
        ("http://a/b", "/c", "http://a/c"),
    ],
)
def test_redirects(url: str, location: str, target: str) -> None:
    assert redirected(url, location) == target


@pytest.mark.parametrize(
    "location", ["http://a/b", "file:///etc/passwd", "data:,x", "", "https://[x"]
)
def test_redirects_that_are_not_followed(location: str) -> None:
    with pytest.raises(DownloadError, match="which is not followed"):
        redirected("https://a/b", location)
