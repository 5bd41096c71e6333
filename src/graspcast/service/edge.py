"""The edge of the service: what holds for every request, before any route sees it.

Access, limits on size and time, one shape of problems, logs and metrics. Bodies are read here,
once, so that no route can forget a limit.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from typing import Any, TypeAlias

from graspcast.service.access import Access
from graspcast.service.limits import Limits
from graspcast.service.logs import REQUESTS
from graspcast.service.metrics import Metrics
from graspcast.service.replies import RefusedError, Reply, problem

__all__ = ["Direct", "Edge"]

Message: TypeAlias = MutableMapping[str, Any]
Receive: TypeAlias = Callable[[], Awaitable[Message]]
Send: TypeAlias = Callable[[Message], Awaitable[None]]
App: TypeAlias = Callable[[Any, Receive, Send], Awaitable[None]]
Direct: TypeAlias = Callable[[bytes], Awaitable[Reply]]
"""Answers a body without path parameters."""

_METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE"})
_OPEN = frozenset({"/health", "/health/ready"})
_DRAINED = 32
"""A body that is too large is read to its end, up to so many times the limit: a client that is
still sending would else see a broken connection, and no answer."""
_CLOSE = ("Connection", "close")

_logger = logging.getLogger(REQUESTS)


class _GoneError(Exception):
    """The client has left before its body was complete."""


class Edge:
    """An ASGI application around another: access, limits, problems, logs and metrics.

    Parameters
    ----------
    app
        The routes.
    access
        Who may ask.
    limits
        How much may be asked.
    metrics
        Where requests are counted.
    direct
        Method and path to what answers it without going through the routes, for speed.
    """

    def __init__(
        self,
        app: App,
        *,
        access: Access,
        limits: Limits,
        metrics: Metrics,
        direct: Mapping[tuple[str, str], Direct],
    ):
        self._app, self._access, self._limits = app, access, limits
        self._metrics, self._direct = metrics, dict(direct)

    async def __call__(self, scope: Any, receive: Receive, send: Send) -> None:
        """Answer a request, or pass on what is none."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began = time.perf_counter()
        method, path = scope["method"], scope["path"]
        try:
            reply = await self._reply(scope, method, path, receive)
        except _GoneError:
            return
        except RefusedError as refusal:
            reply = refusal.reply()
        except Exception:
            _logger.exception("a request failed")
            reply = problem(500, "this is a fault of the service; its log says more")
        await _sent(reply, send)
        seconds = time.perf_counter() - began
        route = path if (method, path) in self._direct else _route(scope)
        method = method if method in _METHODS else "other"
        self._metrics.request(method, route, reply.status, seconds)
        failed = reply.status >= 500 and path not in _OPEN
        level = logging.WARNING if failed else logging.INFO
        if _logger.isEnabledFor(level):
            fields = {
                "method": method,
                "route": route,
                "status": reply.status,
                "ms": round(1e3 * seconds, 2),
                **reply.told,
            }
            _logger.log(level, "request", extra={"fields": fields})

    async def _reply(self, scope: Any, method: str, path: str, receive: Receive) -> Reply:
        headers = dict(scope["headers"])
        self._check_head(scope, headers)
        if path not in _OPEN:
            self._access.check(headers)
        body = await self._body(headers, receive)
        if body:
            _check_type(headers)
        if (direct := self._direct.get((method, path))) is not None:
            return await direct(body)
        return await self._routed(scope, method, body, receive)

    def _check_head(self, scope: Any, headers: Mapping[bytes, bytes]) -> None:
        """Refuse a head that is too large though it came at once, and one without a host."""
        size = len(scope.get("raw_path") or b"") + len(scope["query_string"])
        size += sum(len(name) + len(value) + 4 for name, value in scope["headers"])
        if size > self._limits.head_bytes:
            detail = f"line and headers exceed {self._limits.head_bytes} bytes"
            raise RefusedError(431, detail, headers=(_CLOSE,))
        if b"host" not in headers and scope["http_version"] == "1.1":
            raise RefusedError(400, "the header Host is missing", headers=(_CLOSE,))

    async def _body(self, headers: Mapping[bytes, bytes], receive: Receive) -> bytes:
        """Read a body within the limits of size and time."""
        most = self._limits.body_bytes
        if b"content-length" not in headers and b"transfer-encoding" not in headers:
            return b""
        if b"content-encoding" in headers:
            raise RefusedError(415, "bodies are taken uncompressed alone", headers=(_CLOSE,))
        length = headers.get(b"content-length", b"0")
        if length.isdigit() and int(length) > most and b"expect" in headers:
            raise self._too_large()
        # Most bodies have arrived with their headers: then there is nothing to wait for.
        try:
            async with asyncio.timeout(self._limits.body_s):
                return await self._received(most, receive)
        except TimeoutError as error:
            raise RefusedError(
                408,
                f"the body did not arrive within {self._limits.body_s:g} s",
                headers=(_CLOSE,),
            ) from error

    async def _received(self, most: int, receive: Receive) -> bytes:
        parts, size, more = [], 0, True
        while more:
            message = await receive()
            if message["type"] == "http.disconnect":
                raise _GoneError
            part = message.get("body", b"")
            more = message.get("more_body", False)
            size += len(part)
            if size <= most:
                parts.append(part)
            elif size > _DRAINED * most:
                raise self._too_large()
        if size > most:
            raise self._too_large()
        return b"".join(parts)

    def _too_large(self) -> RefusedError:
        return RefusedError(
            413, f"the body is larger than {self._limits.body_bytes} bytes", headers=(_CLOSE,)
        )

    async def _routed(self, scope: Any, method: str, body: bytes, receive: Receive) -> Reply:
        """Ask the routes, and collect their answer."""
        given = [{"type": "http.request", "body": body, "more_body": False}]

        async def replayed() -> Message:
            return given.pop() if given else await receive()

        status, headers, parts = 500, [], []

        async def collect(message: Message) -> None:
            nonlocal status, headers
            if message["type"] == "http.response.start":
                status, headers = message["status"], message["headers"]
            elif message["type"] == "http.response.body":
                parts.append(message.get("body", b""))

        if method == "HEAD":
            # The answer is that to GET; the server leaves its content out.
            scope["method"] = "GET"
        await self._app(scope, replayed, collect)
        found = {name.decode("latin-1"): value.decode("latin-1") for name, value in headers}
        kind = found.pop("content-type", "")
        found.pop("content-length", None)
        told = scope.get("state", {}).get("told", {})
        return Reply(status, b"".join(parts), kind, tuple(found.items()), told)


async def _sent(reply: Reply, send: Send) -> None:
    await send(
        {"type": "http.response.start", "status": reply.status, "headers": reply.raw_headers()}
    )
    await send({"type": "http.response.body", "body": reply.body})


def _check_type(headers: Mapping[bytes, bytes]) -> None:
    """Raise unless a body is said to be JSON.

    A web page can send other types to another server, this one, without asking it first.
    """
    kind = headers.get(b"content-type", b"").partition(b";")[0].strip().lower()
    if kind != b"application/json":
        raise RefusedError(
            415, "the body must be JSON, with the header 'Content-Type: application/json'"
        )


def _route(scope: Any) -> str:
    """Return the route's template, as metrics and logs name it: never what a client made up."""
    return getattr(scope.get("route"), "path", "other")
