"""Scenes that are being looked at: what is kept of each episode, how many, and for how long."""

from __future__ import annotations

import os
import time
from collections import OrderedDict
from dataclasses import dataclass, field
from threading import Lock
from weakref import WeakMethod

from graspcast.errors import UnknownEpisodeError
from graspcast.forecasting.episodes import Episodes
from graspcast.runtime.frame import Frame

__all__ = ["Scene", "Scenes"]

_KEPT = 20
"""Frames of a scene that are kept, as many as :class:`Episodes` uses."""
_REMEMBERED = 10_000
"""Episodes that have ended of which is known why."""


@dataclass(eq=False)
class Scene:
    """The looks of one episode so far.

    Attributes
    ----------
    lock
        Held while a look is taken: looks of an episode are in order.
    frames
        The frames, the last :data:`_KEPT` of them.
    count
        How many there were.
    numbers
        Dataset and number in it to the number of each instance.
    running
        Number of the model and dataset to its looks; empty where only one was taken.
    """

    frames: list[Frame]
    lock: Lock = field(default_factory=Lock)
    count: int = 1
    numbers: dict[tuple[str, int], int] = field(default_factory=dict)
    running: dict[tuple[int, str], Episodes] = field(default_factory=dict)

    def number(self, dataset: str, instance: int) -> int:
        """Return the number of an instance in the episode, a new one where it has none."""
        return self.numbers.setdefault((dataset, instance), len(self.numbers))

    def next(self) -> int:
        """Return which look the next one is."""
        return self.count + 1

    def add(self, frame: Frame) -> None:
        """Keep a further frame."""
        self.frames = [*self.frames, frame][-_KEPT:]
        self.count += 1


class Scenes:
    """Episodes by id, the least recently used first; several threads may ask.

    Parameters
    ----------
    most
        How many are kept; the least recently used one makes room.
    ttl_s
        Seconds after which one that was not used has expired.
    """

    def __init__(self, most: int, ttl_s: float) -> None:
        self._most, self._ttl_s = most, ttl_s
        self._lock = Lock()
        self._kept: OrderedDict[str, tuple[float, Scene]] = OrderedDict()
        self._ended: OrderedDict[str, str] = OrderedDict()
        if hasattr(os, "register_at_fork"):
            alive = WeakMethod(self._after_fork)
            os.register_at_fork(after_in_child=lambda: (renew := alive()) and renew())

    def __len__(self) -> int:
        return len(self._kept)

    def add(self, episode: str, scene: Scene) -> None:
        """Keep a new episode."""
        now = time.monotonic()
        with self._lock:
            self._expire(now)
            self._kept[episode] = now, scene
            while len(self._kept) > self._most:
                oldest = next(iter(self._kept))
                self._end(oldest, f"made room for others, since {self._most} are kept")

    def get(self, episode: str) -> Scene:
        """Return an episode, which has been used now.

        Raises
        ------
        UnknownEpisodeError
            If there is none of this id (any more), and why.
        """
        now = time.monotonic()
        with self._lock:
            self._expire(now)
            if episode not in self._kept:
                raise self._unknown(episode)
            _, scene = self._kept[episode]
            self._kept[episode] = now, scene
            self._kept.move_to_end(episode)
            return scene

    def forget(self, episode: str) -> None:
        """Forget an episode.

        Raises
        ------
        UnknownEpisodeError
            As :meth:`get`.
        """
        with self._lock:
            if episode not in self._kept:
                raise self._unknown(episode)
            self._end(episode, "was forgotten")

    def _after_fork(self) -> None:  # pragma: no cover - in a fork
        """Renew, in a forked process, what another thread held when it forked."""
        self._lock = Lock()
        for _, scene in self._kept.values():
            scene.lock, scene.running = Lock(), {}

    def _expire(self, now: float) -> None:
        while self._kept:
            episode, (used, _) = next(iter(self._kept.items()))
            if now - used <= self._ttl_s:
                return
            self._end(episode, f"expired: there was no look for {self._ttl_s:g} s")

    def _end(self, episode: str, why: str) -> None:
        del self._kept[episode]
        self._ended[episode] = why
        while len(self._ended) > _REMEMBERED:
            self._ended.popitem(last=False)

    def _unknown(self, episode: str) -> UnknownEpisodeError:
        shown = episode if len(episode) <= 40 else f"{episode[:37]}…"
        why = self._ended.get(episode)
        said = f"{shown} {why}" if why else f"{shown} is not known here"
        return UnknownEpisodeError(
            f"episode {said}; a look without an episode starts a new one", parameters=("episode",)
        )
