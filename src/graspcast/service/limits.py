"""Limits of the service: how much a request, a client and all clients together may take."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Limits"]


@dataclass(frozen=True)
class Limits:
    """How much a request, a client and all clients together may take.

    Attributes
    ----------
    body_bytes
        Size of a request's body; a larger one is answered with 413.
    body_s
        A body that takes longer to arrive is answered with 408, seconds.
    head_bytes
        Size of a request's line and headers; more are answered with 431.
    head_s
        A request's line and headers that take longer to arrive are answered with 408, seconds.
    idle_s
        A connection on which nothing is asked for so long is closed, seconds.
    connections
        Open connections; further ones are answered with 503.
    waiting
        Requests that wait for a verdict or for the log; further ones are answered with 503.
    batch
        Most frames that are judged at once.
    stop_s
        On a stop, requests that were accepted have so long to be answered, seconds.
    """

    body_bytes: int = 1_000_000
    body_s: float = 10.0
    head_bytes: int = 32_768
    head_s: float = 10.0
    idle_s: float = 30.0
    connections: int = 512
    waiting: int = 512
    batch: int = 32
    stop_s: float = 30.0
