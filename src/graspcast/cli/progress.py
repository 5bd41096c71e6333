"""Progress of verbs on standard error: a bar on a terminal, elsewhere a line every ten seconds.

:func:`running` is about every verb, so each that takes longer has its lines, and
:func:`progress_bar` about the parts of its work of which the share done is known.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Protocol, runtime_checkable

from graspcast.cli.pace import Pace, in_words
from graspcast.errors import InputError
from graspcast.io.progress import Count

__all__ = ["INTERVAL", "Move", "interval", "progress_bar", "running", "waiting"]

INTERVAL = "GRASPCAST_PROGRESS_S"
"""The environment variable with the seconds between two lines; 0 for none."""

_INTERVAL_S, _FIRST_S = 10.0, 2.0
_SAME_SHARE = 0.01


@runtime_checkable
class Move(Protocol):
    """A function that updates the progress."""

    def __call__(self, share: float, message: str = ...) -> None:
        """Show a share done, from 0 to 1, and a message."""
        ...


class _Work:
    """A part of a verb's work: its name, when it began, and what was reported last."""

    def __init__(self, text: str) -> None:
        self.text, self.began = text, time.monotonic()
        self.pace, self.share, self.message = Pace(), 0.0, ""
        self._reported = False

    def report(self, share: float, message: str) -> None:
        if isinstance(message, Count) and abs(message.share - share) > _SAME_SHARE:
            message = str(message)  # counts one step of several
        self.share, self.message, self._reported = share, message, True
        self.pace.report(share, message)

    def words(self) -> str:
        """Say what is done, and how much time is left or, where that is not known, was needed."""
        left = self.pace.left()
        late = left or f"{in_words(time.monotonic() - self.began)} so far"
        if isinstance(message := self.message, Count):
            done = f"{Count(message.done, message.total, message.things)} ({self.share:.0%})"
            parts = [done, self.pace.rate(), message.more, late]
        elif self._reported and self.share > 0:
            parts = [self.text, f"{self.share:.0%}", message, late]
        else:
            parts = [self.text, message, late]
        return ", ".join(dict.fromkeys(filter(None, parts)))


class _Verbs:
    """What runs: verbs, one inside another in the demonstration, and the parts of their work."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.verbs: list[_Work] = []
        self.parts: list[_Work] = []
        self.waiting = 0

    def line(self, of: _Work) -> str:
        """Return the line of a verb; empty if another runs inside it, or nobody waits for it."""
        with self.lock:
            if not self.verbs or self.verbs[-1] is not of or self.waiting:
                return ""
            work = self.parts[-1] if self.parts else of
            verb, words = of.text, work.words()
            return f"{verb}: {words.removeprefix(f'{verb}, ')}"

    def long(self, seconds: float) -> bool:
        """Whether the work is known to take at least so many seconds more."""
        with self.lock:
            left = self.parts[-1].pace.seconds_left() if self.parts else None
            return left is not None and left >= seconds


_RUNNING = _Verbs()


def interval() -> float:
    """Return the seconds between two lines; 0 for no lines.

    Raises
    ------
    InputError
        If the environment variable is not a number of seconds.
    """
    text = os.environ.get(INTERVAL, "")
    try:
        seconds = float(text) if text else _INTERVAL_S
    except ValueError:
        seconds = -1.0
    if not 0 <= seconds <= threading.TIMEOUT_MAX:
        raise InputError(
            f"the environment variable {INTERVAL} is the number of seconds between two lines of "
            f"progress, 0 for none, not {text!r}"
        )
    return seconds


@contextmanager
def running(verb: str) -> Iterator[None]:
    """Report the progress of a verb while it runs.

    Where standard error is no terminal, a thread writes a line every ten seconds, the first after
    two if the work is known to be long.
    """
    seconds = interval()
    work, ended = _Work(verb), threading.Event()
    with _RUNNING.lock:
        _RUNNING.verbs.append(work)
    lines = seconds > 0 and not _on_terminal()
    thread = threading.Thread(target=_write_lines, args=(work, ended, seconds), daemon=True)
    if lines:
        thread.start()
    try:
        yield
    finally:
        ended.set()
        if lines:
            thread.join()
        with _RUNNING.lock:
            _RUNNING.verbs.pop()


@contextmanager
def waiting() -> Iterator[None]:
    """Write no lines inside: a server or window is open, which waits for its users."""
    with _RUNNING.lock:
        _RUNNING.waiting += 1
    try:
        yield
    finally:
        with _RUNNING.lock:
            _RUNNING.waiting -= 1


@contextmanager
def progress_bar(text: str) -> Iterator[Move]:
    """Show the progress of a part of the work; yield the function that updates it.

    Parameters
    ----------
    text
        What is being done.
    """
    work = _Work(text)
    with _RUNNING.lock:
        alone = not _RUNNING.parts
        _RUNNING.parts.append(work)
    try:
        if alone and _on_terminal():
            with _bar(work) as move:
                yield move
        else:

            def report(share: float, message: str = "") -> None:
                with _RUNNING.lock:
                    work.report(share, message)

            yield report
    finally:
        with _RUNNING.lock:
            _RUNNING.parts.remove(work)


@contextmanager
def _bar(work: _Work) -> Iterator[Move]:
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import Progress, TimeElapsedColumn, TimeRemainingColumn

    columns = (*Progress.get_default_columns()[:-1], TimeRemainingColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True) as bar:
        # A share that is not known yet is a bar that pulses.
        task = bar.add_task(escape(work.text), total=None)

        def move(share: float, message: str = "") -> None:
            work.report(share, message)
            rate = work.pace.rate()
            told = ", ".join(filter(None, [message or work.text, rate]))
            bar.update(
                task, completed=share, total=1.0 if share else None, description=escape(told)
            )

        yield move


def _on_terminal() -> bool:
    """Whether standard error is a terminal on which a bar can be drawn."""
    try:
        return sys.stderr.isatty() and os.environ.get("TERM") not in ("dumb", "unknown")
    except (AttributeError, ValueError):  # no standard error, or closed
        return False


def _write_lines(work: _Work, ended: threading.Event, seconds: float) -> None:
    """Write lines until a verb has ended."""
    first = min(_FIRST_S, seconds)
    if ended.wait(first):
        return
    if first == seconds or _RUNNING.long(seconds):
        _write(_RUNNING.line(work))
    due = time.monotonic() + seconds - (first if first < seconds else 0.0)
    while not ended.wait(max(0.0, due - time.monotonic())):
        _write(_RUNNING.line(work))
        due = max(due + seconds, time.monotonic())


def _write(line: str) -> None:
    # A pipe that nobody reads, or no standard error, is no reason to stop the work.
    with suppress(OSError, ValueError, AttributeError):
        if line:
            sys.stderr.write(f"{line}\n")
            sys.stderr.flush()
