"""Answers: what their headers say, however odd."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from graspcast.fetching.requests import Answer


def answer(**headers: str) -> Answer:
    lower = {name.replace("_", "-").lower(): value for name, value in headers.items()}
    return Answer(SimpleNamespace(status_code=200, headers=lower), "https://host/a", "")


@pytest.mark.parametrize(
    ("text", "length"), [("12", 12), ("", None), ("-1", None), ("1e3", None), ("²", None)]
)
def test_lengths(text: str, length: int | None) -> None:
    assert answer(Content_Length=text).content_length == length


@pytest.mark.parametrize(
    ("text", "range_"),
    [
        ("bytes 4-9/10", (4, 10)),
        ("bytes 4-9/*", (4, None)),
        ("bytes */10", None),
        ("items 4-9/10", None),
        ("", None),
    ],
)
def test_ranges(text: str, range_: tuple[int, int | None] | None) -> None:
    assert answer(Content_Range=text).content_range == range_


def test_other_headers() -> None:
    assert answer(Content_Range="bytes */10").unsatisfied_length == 10
    assert answer(Content_Encoding="Identity").encoding == ""
    assert answer(Content_Encoding="gzip").encoding == "gzip"
    assert answer(Retry_After="7").retry_after_s == 7
    assert answer(Retry_After="Tue, 01 Oct 2024 00:00:00 GMT").retry_after_s == 0
    assert answer(ETag='"a"', Last_Modified="b").version(3).etag == '"a"'
