"""Synchroniser: messages of several estimators, put together by the time of their image."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

from graspcast.errors import InputError, UnknownNameError
from graspcast.ros.poses import Stamp
from graspcast.ros.problems import Problems

__all__ = ["Synchronised", "Synchroniser"]

_REMEMBERED = 100
"""Sets that were given out; a message that belongs to one of them came too late."""


@dataclass
class Synchronised:
    """Messages whose stamps agree.

    Attributes
    ----------
    stamp
        Of the message that came first, nanoseconds.
    arrived
        When that was, by the receiver's clock, nanoseconds.
    messages
        Stream's name to its message.
    stamps
        Stream's name to its stamp.
    """

    stamp: Stamp
    arrived: Stamp
    messages: dict[str, Any] = field(default_factory=dict)
    stamps: dict[str, Stamp] = field(default_factory=dict)

    def distance(self, stamp: Stamp) -> int:
        """Return how far a stamp lies from the farthest one here, nanoseconds."""
        return max(abs(stamp - other) for other in self.stamps.values())


class Synchroniser:
    """Sets of messages of several streams, one set an image.

    Messages belong together if their stamps differ by at most the tolerance. A set is given out
    when it is complete or, without the streams that are missing, when it has waited for the
    timeout. Sets come out in the order of their stamps: one that is complete waits for an earlier
    one that is not, at most for the timeout. So a detector that finds nothing should send an empty
    message. A message that comes after its set was given out is late: it is counted, and not used.

    Parameters
    ----------
    streams
        Names of the streams.
    tolerance_s
        Largest difference of stamps within a set; less than half the time between two images.
    timeout_s
        How long a set waits for streams that are missing, from its first message on.

    Attributes
    ----------
    problems
        Messages that were not used, counted.
    """

    def __init__(
        self, streams: Collection[str], *, tolerance_s: float = 0.02, timeout_s: float = 0.5
    ):
        for name, value in (("tolerance_s", tolerance_s), ("timeout_s", timeout_s)):
            if not 0 <= value <= 3600:
                raise InputError(
                    f"{name} should be between 0 and 3600 seconds, but is {value}",
                    parameters=(name,),
                )
        if not streams:
            raise InputError("there should be at least one stream of estimates")
        self._streams = tuple(streams)
        self._tolerance, self._timeout = round(tolerance_s * 1e9), round(timeout_s * 1e9)
        self._waiting: list[Synchronised] = []
        self._done: deque[Synchronised] = deque(maxlen=_REMEMBERED)
        self.problems = Problems()

    def __len__(self) -> int:
        return len(self._waiting)

    def clear(self) -> None:
        """Forget all sets, as when a clock was set back."""
        self._waiting.clear()
        self._done.clear()

    def add(self, stream: str, stamp: Stamp, message: Any, now: Stamp) -> None:
        """Add a message.

        Parameters
        ----------
        stream
            Name of its stream.
        stamp
            Of its image, nanoseconds.
        message
            Anything.
        now
            Time of arrival by the receiver's clock, nanoseconds.

        Raises
        ------
        UnknownNameError
            For a stream that was not named.
        """
        if stream not in self._streams:
            raise UnknownNameError("stream", stream, self._streams)
        if stamp <= 0:
            self.problems.add("message without a stamp", stream)
            return
        near = [s for s in self._waiting if s.distance(stamp) <= self._tolerance]
        free = [s for s in near if stream not in s.messages]
        if len(free) < len(near) and not free:
            self.problems.add("message that repeats a stamp within the tolerance", stream)
            return
        if len(free) > 1:
            self.problems.add("message that fits two images: the tolerance is too large", stream)
        if not free:
            if any(s.distance(stamp) <= self._tolerance for s in self._done):
                self.problems.add("message that came too late", stream)
                return
            free = [Synchronised(stamp, now)]
            self._waiting.append(free[0])
            self._waiting.sort(key=lambda s: s.stamp)
        chosen = min(free, key=lambda s: abs(s.stamp - stamp))
        chosen.messages[stream] = message
        chosen.stamps[stream] = stamp

    def due(self, now: Stamp) -> list[Synchronised]:
        """Return the sets that are complete or have waited long enough, by stamp, each once."""
        out = []
        while self._waiting and self._is_due(self._waiting[0], now):
            out.append(self._waiting.pop(0))
        self._done.extend(out)
        return out

    def rest(self) -> list[Synchronised]:
        """Return the sets that still wait, by stamp, as at the end of a bag."""
        out, self._waiting = self._waiting, []
        self._done.extend(out)
        return out

    def missing(self, found: Synchronised) -> list[str]:
        """Return the streams that a set lacks."""
        return [name for name in self._streams if name not in found.messages]

    def _is_due(self, waiting: Synchronised, now: Stamp) -> bool:
        complete = len(waiting.messages) == len(self._streams)
        return complete or now - waiting.arrived >= self._timeout
