"""Download of a file: resumed, tried again after failures, and limited in size."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from graspcast.errors import DownloadError
from graspcast.fetching.addresses import local_path, shown
from graspcast.fetching.disk import check_space, in_words, writing
from graspcast.fetching.limits import Limits
from graspcast.fetching.partial_file import PartialFile
from graspcast.fetching.requests import Answer, TryAgainError, client, get

__all__ = ["Downloaded", "download"]

Arrived = Callable[[int, int | None, str], None]
"""Called with the bytes that have arrived, those in all if known, and a remark."""

_TEMPORARY = (408, 425, 429, 500, 502, 503, 504)
_CHUNK = 1 << 16


@dataclass(frozen=True)
class Downloaded:
    """A file that was downloaded.

    Attributes
    ----------
    path
        The file.
    sha256
        Its digest.
    stated
        The digest that the server stated, and that it has; empty where it stated none.
    """

    path: Path
    sha256: str
    stated: str


def download(
    url: str, target: Path, *, most_bytes: int, limits: Limits, arrived: Arrived
) -> Downloaded:
    """Download a file, from where an earlier attempt ended if that is possible.

    Parameters
    ----------
    url
        ``https://``, ``http://`` or ``file://``.
    target
        Where it is to be. No other process may download to it at the same time.
    most_bytes
        Largest size.
    limits
        Times and attempts.
    arrived
        Called as the file arrives.

    Raises
    ------
    DownloadError
        If it cannot be had, is larger, or has not the digest that the server states.
    ExtraMissingError
        If httpx is not installed.
    """
    part = PartialFile(target, url)
    if (done := part.finished()) is not None:
        return Downloaded(target, *done)
    source = local_path(url)
    if source is not None:
        stated = _copy(source, part, most_bytes, limits, arrived)
    else:
        stated = _from_server(url, part, most_bytes, limits, arrived)
    sha256 = part.finish(stated)
    if stated and sha256 != stated:
        part.discard()
        raise DownloadError(
            f"{shown(url)}: its SHA-256 is {sha256}, and not {stated} as the server states; it was "
            "damaged on the way or changed meanwhile, and is removed: try again"
        )
    return Downloaded(target, sha256, stated)


def _copy(source: Path, part: PartialFile, most: int, limits: Limits, arrived: Arrived) -> str:
    try:
        if not source.is_file():
            raise DownloadError(
                f"{source}: there is no such file in the mirror", parameters=("mirror",)
            )
        size = source.stat().st_size
        check_space(part.target, size, limits.spare_bytes, most=most)
        with source.open("rb") as stream:
            part.begin(part.version)
            _write(iter(lambda: stream.read(_CHUNK), b""), part, most, size, arrived)
    except OSError as error:
        raise DownloadError(f"{source}: cannot be read ({error.strerror})") from error
    return ""


def _from_server(url: str, part: PartialFile, most: int, limits: Limits, arrived: Arrived) -> str:
    """Try until it is whole; return the digest that the server states."""
    failures, wait = 0, limits.backoff_s
    with client(limits) as http:
        while True:
            before = part.size
            try:
                return _attempt(http, url, part, most, limits, arrived)
            except TryAgainError as again:
                gained = part.size - before
                failures = 1 if gained >= limits.progress_bytes else failures + 1
                wait = limits.backoff_s if failures == 1 else wait * 2
                most_failures = limits.attempts if again.answered else limits.unreachable_attempts
                pause = max(wait, again.wait_s)
                if failures >= most_failures or again.wait_s > limits.longest_wait_s:
                    raise DownloadError(_given_up(url, part, again, failures)) from again
                arrived(part.size, part.version.length, f"{again.reason}; trying again")
            time.sleep(min(pause, limits.longest_wait_s))


def _given_up(url: str, part: PartialFile, again: TryAgainError, failures: int) -> str:
    kept = f"; {in_words(part.size)} are kept, and resumed next time" if part.resumable() else ""
    asked = f"; the server asks to wait {again.wait_s:.0f} s" if again.wait_s else ""
    times = "attempt" if failures == 1 else "attempts in a row"
    return f"{shown(url)}: {again.reason} ({failures} {times} failed){asked}{kept}"


def _attempt(
    http: Any, url: str, part: PartialFile, most: int, limits: Limits, arrived: Arrived
) -> str:
    have = part.resumable()
    headers = {"Range": f"bytes={have}-", "If-Range": part.version.validator} if have else {}
    with get(http, url, headers, limits) as answer:
        if have and answer.status == 416:
            if answer.unsatisfied_length == have:
                return answer.stated_sha256  # all of it had arrived
            part.discard()
            raise TryAgainError("the server has a shorter file than before")
        start, length = _accepted(answer, part, have, url)
        if length is not None:
            check_space(part.target, length - start, limits.spare_bytes, size=length, most=most)
        packed = answer.encoding and not part.target.name.endswith(".gz")
        body = answer.response.iter_bytes() if packed else answer.response.iter_raw()
        _write(_lively(body, limits), part, most, length, arrived)
        if length is not None and part.size != length:
            if part.size > length:
                part.discard()
            raise TryAgainError(f"the server sent {part.size:,} of {length:,} bytes")
        return answer.stated_sha256


def _accepted(answer: Answer, part: PartialFile, have: int, url: str) -> tuple[int, int | None]:
    """Return from which byte the body is, and the file's length; begin anew where it is all."""
    if answer.status == 206 and have:
        stated = answer.content_range
        if stated is None or stated[0] != have or answer.encoding:
            part.discard()
            raise TryAgainError("the server answered with another part than was asked for")
        version = answer.version(stated[1])
        if version.contradicts(part.version):
            part.discard()
            raise TryAgainError("the file on the server has changed")
        return have, stated[1] if stated[1] is not None else part.version.length
    if answer.status == 200:
        length = None if answer.encoding else answer.content_length
        version = answer.version(length)
        if answer.encoding:
            version = type(version)()  # no part of it can be asked for
        part.begin(version)
        return 0, length
    if answer.status in _TEMPORARY:
        raise TryAgainError(f"the server answered {answer.status}", wait_s=answer.retry_after_s)
    hints = {
        401: "it wants a login",
        403: "it refuses access",
        404: "there is no such file",
        407: "the proxy wants a login",
        410: "the file is gone",
    }
    hint = hints.get(answer.status, "that is no file")
    raise DownloadError(
        f"{shown(url)}: the server answered {answer.status}: {hint}", parameters=("mirror",)
    )


def _lively(body: Iterable[bytes], limits: Limits) -> Iterable[bytes]:
    """Pass on what arrives, while enough does."""
    due, amount = time.monotonic() + limits.stall_s, 0
    for chunk in body:
        yield chunk
        amount += len(chunk)
        if (now := time.monotonic()) > due:
            if amount < limits.stall_bytes:
                raise TryAgainError(f"only {amount} bytes arrived in {limits.stall_s:g} s")
            due, amount = now + limits.stall_s, 0


def _write(
    chunks: Iterable[bytes], part: PartialFile, most: int, length: int | None, arrived: Arrived
) -> None:
    size = part.size
    with part.path.open("ab") as stream:
        for chunk in chunks:
            size += len(chunk)
            if size > most:
                stream.close()
                part.discard()
                raise DownloadError(
                    f"{shown(part.url)}: is larger than {in_words(most)}, the limit for "
                    f"{part.target.name}"
                )
            with writing(part.path):
                stream.write(chunk)
                stream.flush()
            arrived(size, length, "")
