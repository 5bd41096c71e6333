"""Bounded streams."""

from __future__ import annotations

import io

import pytest

from graspcast.fetching.tar_stream import BoundedStream, OversizeError


def test_it_reads_as_its_stream_does() -> None:
    stream = BoundedStream(io.BytesIO(b"0123456789"), 100)
    assert stream.read(3) == b"012"
    assert stream.seek(5) == stream.tell() == 5
    assert stream.read(100 - 5) == b"56789"


def test_limits() -> None:
    stream = BoundedStream(io.BytesIO(b"0123456789"), 8)
    for size in (2**25, -1):
        with pytest.raises(OversizeError, match="header"):
            stream.read(size)
    with pytest.raises(OversizeError, match="unpacks to more"):
        stream.read(9)
    with pytest.raises(OversizeError, match="unpacks to more"):
        stream.seek(9)
    with pytest.raises(OversizeError, match="from the end"):
        stream.seek(0, 2)
