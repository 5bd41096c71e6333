"""Replies: what a request is answered with, and problems as JSON of one shape (RFC 9457)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any

from pydantic_core import to_json

from graspcast.errors import GraspcastError

__all__ = ["JSON", "PROBLEM", "RefusedError", "Reply", "json_reply", "problem", "problem_of"]

JSON = "application/json"
PROBLEM = "application/problem+json"
_MOST_TEXT = 2000


@dataclass(frozen=True)
class Reply:
    """What a request is answered with.

    Attributes
    ----------
    status
        HTTP status.
    body
        Content.
    media_type
        Of the content.
    headers
        Further headers.
    told
        What the line in the log has further: counts, or why it failed.
    """

    status: int
    body: bytes
    media_type: str = JSON
    headers: tuple[tuple[str, str], ...] = ()
    told: Mapping[str, int | str] = field(default_factory=dict)

    def raw_headers(self) -> list[tuple[bytes, bytes]]:
        """Return all headers as ASGI has them."""
        return [
            (b"content-type", self.media_type.encode("latin-1")),
            (b"content-length", str(len(self.body)).encode("latin-1")),
            *((k.encode("latin-1"), v.encode("latin-1")) for k, v in self.headers),
        ]


class RefusedError(Exception):
    """A request that is answered with a problem.

    Parameters
    ----------
    status
        HTTP status.
    detail
        What is wrong, and what to do.
    errors
        Places in the request and what is wrong there.
    headers
        Further headers.
    """

    def __init__(
        self,
        status: int,
        detail: str,
        *,
        errors: Sequence[tuple[str, str]] = (),
        headers: tuple[tuple[str, str], ...] = (),
    ):
        super().__init__(detail)
        self.status, self.detail, self.errors, self.headers = status, detail, errors, headers

    def reply(self) -> Reply:
        """Return the problem as a reply."""
        return problem(self.status, self.detail, errors=self.errors, headers=self.headers)


def json_reply(content: Any, *, told: Mapping[str, int] | None = None) -> Reply:
    """Return a reply with JSON of plain values."""
    return Reply(200, to_json(content), told=told or {})


def problem(
    status: int,
    detail: str,
    *,
    errors: Sequence[tuple[str, str]] = (),
    headers: tuple[tuple[str, str], ...] = (),
) -> Reply:
    """Return a problem as a reply: its status, what is wrong, and where."""
    content: dict[str, Any] = {
        "type": "about:blank",
        "title": HTTPStatus(status).phrase,
        "status": status,
        "detail": _cut(detail),
        "errors": [{"where": _cut(where), "problem": _cut(what)} for where, what in errors],
    }
    # What the service could not do is told in its log too; what the client did is not.
    told = {"detail": content["detail"]} if status >= 500 else {}
    return Reply(status, to_json(content), PROBLEM, headers, told)


def problem_of(error: GraspcastError, status: int = 422) -> RefusedError:
    """Return one of the library's errors as a refusal, with the library's message."""
    return RefusedError(status, str(error))


def _cut(text: str) -> str:
    """Return a text that UTF-8 can hold, and that is not endless."""
    text = text.encode("utf-8", "replace").decode("utf-8")
    return text if len(text) <= _MOST_TEXT else f"{text[:_MOST_TEXT]} ..."
