"""The server: from a watcher to a process that answers, and stops without losing a request."""

from __future__ import annotations

import logging
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

import uvicorn

from graspcast.errors import InputError
from graspcast.service.access import TOKEN_VARIABLE, is_loopback
from graspcast.service.app import create_app
from graspcast.service.limits import Limits
from graspcast.service.protocol import limited_protocol

if TYPE_CHECKING:
    from graspcast.runtime.watcher import Watcher
    from graspcast.service.app import Monitor

__all__ = ["listen", "serve"]

_logger = logging.getLogger(__name__)
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def listen(host: str, port: int, token: str | None) -> socket.socket:
    """Return a socket that listens, on this machine alone unless there is a token.

    Raises
    ------
    InputError
        For another host than the loopback without a token, and for an address that is not free.
    """
    if token is None and not is_loopback(host):
        raise InputError(
            f"{host}: whoever reaches this address could ask, so a token is needed: set the "
            f"environment variable {TOKEN_VARIABLE}; or listen on 127.0.0.1",
            parameters=("host",),
        )
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, backlog=1024)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"{host}, port {port}: cannot listen there ({reason})", parameters=("host", "port")
        ) from error


def serve(
    watcher: Watcher,
    listener: socket.socket,
    *,
    token: str | None = None,
    limits: Limits | None = None,
    monitor: Monitor | None = None,
) -> None:
    """Answer requests until a signal comes (SIGTERM, SIGINT); a second one does not wait.

    Parameters
    ----------
    watcher
        Judges and records.
    listener
        From :func:`listen`.
    token
        The bearer token that clients must show.
    limits
        How much may be asked.
    monitor
        As for :func:`~graspcast.service.app.create_app`.
    """
    limits = limits or Limits()
    config = uvicorn.Config(
        create_app(watcher, token=token, limits=limits, monitor=monitor),
        http=limited_protocol(limits),
        ws="none",
        lifespan="on",
        log_config=None,
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        timeout_keep_alive=int(limits.idle_s),
        timeout_graceful_shutdown=int(limits.stop_s),
    )
    host, port = listener.getsockname()[:2]
    url = f"http://{f'[{host}]' if ':' in host else host}:{port}"
    _logger.info("listening", extra={"fields": {"url": url, "token": token is not None}})
    _Server(config).run(sockets=[listener])
    _logger.info("stopped")


class _Server(uvicorn.Server):
    """uvicorn's server, which ends as usual after a signal, and is not killed by it again."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Stop at a signal: at once, if it is the second."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.signal(number, self._stop) for number in _SIGNALS}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _stop(self, number: int, _: FrameType | None) -> None:
        _logger.info("stopping", extra={"fields": {"signal": signal.Signals(number).name}})
        self.force_exit = self.should_exit
        self.should_exit = True
