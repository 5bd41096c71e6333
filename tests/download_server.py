"""A server of files for tests of downloads, which lies, stalls and breaks off as it is told."""

from __future__ import annotations

import gzip
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

Reply = Callable[["Handler"], None]


@dataclass
class Server:
    """What is served: replies by path, one a request, the last one again and again."""

    url: str = ""
    replies: dict[str, list[Reply]] = field(default_factory=dict)
    asked: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    ended: threading.Event = field(default_factory=threading.Event)

    def give(self, path: str, *replies: Reply) -> str:
        self.replies[f"/{path}"] = list(replies)
        return f"{self.url}/{path}"

    def ranges(self, path: str) -> list[str]:
        """The ranges that were asked for, one a request."""
        return [headers.get("range", "") for p, headers in self.asked if p == f"/{path}"]


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: _Http

    def do_GET(self) -> None:
        world = self.server.world
        world.asked.append((self.path, {k.lower(): v for k, v in self.headers.items()}))
        replies = world.replies.get(self.path) or [status(404)]
        reply = replies.pop(0) if len(replies) > 1 else replies[0]
        with suppress(BrokenPipeError, ConnectionResetError):
            reply(self)

    def log_message(self, *_: object) -> None:
        pass

    def head(self, code: int, **headers: str) -> None:
        self.send_response(code)
        self.send_header("Connection", "close")
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        self.close_connection = True


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    world: Server


@contextmanager
def serving() -> Iterator[Server]:
    with _Http(("127.0.0.1", 0), Handler) as http:
        http.world = Server(f"http://127.0.0.1:{http.server_address[1]}")
        thread = threading.Thread(target=http.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield http.world
        finally:
            http.world.ended.set()
            http.shutdown()
            thread.join()


def whole(content: bytes, etag: str = '"v1"', *, ranges: bool = True) -> Reply:
    """A good server, or one that ignores ranges."""

    def reply(to: Handler) -> None:
        asked, same = to.headers.get("Range"), to.headers.get("If-Range") in (None, etag)
        if ranges and asked and same:
            start = int(asked.removeprefix("bytes=").rstrip("-"))
            if start >= len(content):
                to.head(416, Content_Range=f"bytes */{len(content)}", Content_Length="0")
                return
            part = content[start:]
            to.head(
                206,
                ETag=etag,
                Content_Length=str(len(part)),
                Content_Range=f"bytes {start}-{len(content) - 1}/{len(content)}",
            )
            to.wfile.write(part)
            return
        to.head(200, ETag=etag, Content_Length=str(len(content)))
        to.wfile.write(content)

    return reply


def cut(content: bytes, at: int, etag: str = '"v1"', *, says: int | None = None) -> Reply:
    """Breaks off after some bytes from the start; ``says`` is the length that it states."""

    def reply(to: Handler) -> None:
        length = len(content) if says is None else says
        to.head(200, ETag=etag, Content_Length=str(length))
        to.wfile.write(content[:at])

    return reply


def stalled(content: bytes, at: int, etag: str = '"v1"', *, trickle: bool = False) -> Reply:
    """Sends some bytes, and then none, or one now and then."""

    def reply(to: Handler) -> None:
        to.head(200, ETag=etag, Content_Length=str(len(content)))
        to.wfile.write(content[:at])
        to.wfile.flush()
        for i in range(at, len(content)):
            if to.server.world.ended.wait(0.02 if trickle else 60.0) or not trickle:
                return
            to.wfile.write(content[i : i + 1])
            to.wfile.flush()

    return reply


def status(code: int, **headers: str) -> Reply:
    def reply(to: Handler) -> None:
        to.head(code, Content_Length="0", **headers)

    return reply


def raw(code: int, body: bytes, **headers: str) -> Reply:
    def reply(to: Handler) -> None:
        to.head(code, Content_Length=str(len(body)), **headers)
        to.wfile.write(body)

    return reply


def gzipped(content: bytes) -> Reply:
    return raw(200, gzip.compress(content), Content_Encoding="gzip", ETag='"packed"')
