"""The HTTP protocol of one connection, with limits on slow and large heads of requests.

uvicorn waits for a request's headers without end, and takes any number of them.
"""

from __future__ import annotations

import asyncio
from http import HTTPStatus
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from graspcast.service.limits import Limits
from graspcast.service.replies import problem

__all__ = ["LimitedProtocol", "limited_protocol"]


class LimitedProtocol(HttpToolsProtocol):
    """A connection whose requests must begin in time."""

    limits = Limits()

    _timer: asyncio.TimerHandle | None = None
    _head = 0
    _in_head = True

    def connection_made(self, transport: Any) -> None:
        """Begin to wait for a request, unless there are too many connections."""
        super().connection_made(transport)
        if len(self.connections) > self.limits.connections:
            detail = f"{self.limits.connections} connections are open; try again later"
            self._refuse(503, detail, (("Retry-After", "1"),))
            return
        self._wait_for_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop waiting."""
        self._stop_waiting()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take bytes, unless they are too many before the headers end."""
        if self.transport.is_closing():
            return
        if self._in_head:
            self._head += len(data)
        super().data_received(data)
        if self._in_head and self._head > self.limits.head_bytes:
            self._refuse(431, f"line and headers exceed {self.limits.head_bytes} bytes")

    def on_message_begin(self) -> None:
        """Begin a request."""
        super().on_message_begin()
        self._in_head = True
        self._wait_for_head()

    def on_headers_complete(self) -> None:
        """Hand over a request whose headers are complete."""
        self._stop_waiting()
        self._in_head, self._head = False, 0
        super().on_headers_complete()

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP."""
        self._refuse(400, "this is not a request of HTTP/1.1")

    def _wait_for_head(self) -> None:
        if self._timer is None:
            self._timer = self.loop.call_later(self.limits.head_s, self._too_slow)

    def _stop_waiting(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _too_slow(self) -> None:
        self._timer = None
        if self._answering():
            self._wait_for_head()
        elif not self.transport.is_closing():
            self._refuse(408, f"no request came within {self.limits.head_s:g} s")

    def _refuse(self, status: int, detail: str, headers: tuple[tuple[str, str], ...] = ()) -> None:
        self._stop_waiting()
        if self.transport.is_closing():
            return
        if not self._answering():
            reply = problem(status, detail, headers=(*headers, ("Connection", "close")))
            lines = [f"HTTP/1.1 {status} {HTTPStatus(status).phrase}".encode()]
            lines += [name + b": " + value for name, value in reply.raw_headers()]
            self.transport.write(b"\r\n".join([*lines, b"", reply.body]))
        self.transport.close()

    def _answering(self) -> bool:
        """Whether a request that came whole is still to be answered."""
        cycle = self.cycle
        if cycle is None or cycle.response_complete:
            return False
        return cycle.response_started or not cycle.more_body or bool(self.pipeline)


def limited_protocol(limits: Limits) -> type[asyncio.Protocol]:
    """Return uvicorn's protocol with limits on heads of requests and on connections."""
    return type("Limited", (LimitedProtocol,), {"limits": limits})
