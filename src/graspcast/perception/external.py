"""A pose estimator that is a command: its template, and the process in which it runs.

The process has whatever Python, libraries and GPU it needs; files are all that it and graspcast
share.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from io import TextIOBase
from pathlib import Path
from threading import Thread, current_thread, main_thread
from typing import Any

from graspcast.errors import EstimatorFailedError, InputError, UnknownNameError

__all__ = ["command_line", "run_command"]

_PLACEHOLDER = re.compile(r"(?<!\$)\{(\w+)\}")
_QUOTED_LINES = 15
_GRACE_S = 5.0
"""From asking processes to end (SIGTERM) to ending them (SIGKILL)."""


def _nobody(line: str) -> None:
    del line


def command_line(template: str, paths: Mapping[str, Path]) -> list[str]:
    """The words of a command template, with its placeholders filled in.

    The template is split as a shell would split it and only then filled in, so a path with spaces
    stays one word. No shell runs it: ``|``, ``>`` and ``$NAME`` mean nothing.

    Parameters
    ----------
    template
        For example ``"python infer.py --images {bop} --save {out}"``.
    paths
        What each placeholder stands for; ``out`` is among them.

    Raises
    ------
    InputError
        If the template cannot be split, or has no ``{out}``.
    UnknownNameError
        For a placeholder that is not in ``paths``.
    """
    try:
        words = shlex.split(template)
    except ValueError as error:
        raise InputError(f"--estimator {template!r} is no command: {error}") from error
    used = {name for word in words for name in _PLACEHOLDER.findall(word)}
    for name in sorted(used - set(paths)):
        known = [f"{{{known}}}" for known in paths]
        raise UnknownNameError("placeholder", f"{{{name}}}", known, hint=f"In {template!r}")
    if "out" not in used:
        raise InputError(
            f"--estimator {template!r}: no {{out}}, the file to which the command writes its poses"
        )
    return [_PLACEHOLDER.sub(lambda match: str(paths[match.group(1)]), word) for word in words]


def run_command(
    command: Sequence[str],
    *,
    timeout_s: float | None = None,
    say: Callable[[str], None] = _nobody,
) -> None:
    """Run a command to its end.

    When it returns or raises, whatever the reason (Ctrl-C too), the command has ended and so have
    the processes that it left in its group.

    Parameters
    ----------
    command
        The program and its arguments.
    timeout_s
        After so many seconds it is ended.
    say
        Takes each line that it prints; called from other threads.

    Raises
    ------
    EstimatorFailedError
        If it cannot be started, takes too long, or its exit code is not 0; with the last lines of
        its standard error.
    """
    own_group: dict[str, Any] = {"start_new_session": True}
    if sys.platform == "win32":
        own_group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            **own_group,
        )
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise EstimatorFailedError(command, f"cannot be started ({reason})") from error
    last: deque[str] = deque(maxlen=_QUOTED_LINES)

    def pass_on(stream: TextIOBase, keep: bool) -> None:
        with stream:
            for line in stream:
                if line := line.strip():
                    say(line)
                    if keep:
                        last.append(line)

    streams = ((process.stdout, False), (process.stderr, True))
    readers = [Thread(target=pass_on, args=pair, daemon=True) for pair in streams]
    for reader in readers:
        reader.start()
    problem = None
    try:
        with _told_to_end():
            code = process.wait(timeout_s)
        if code:
            problem = (
                f"was ended by signal {-code}" if code < 0 else f"failed with exit code {code}"
            )
    except subprocess.TimeoutExpired:
        problem = f"was ended, for it took longer than the {timeout_s:g} s of --timeout"
    finally:
        _end(process)
        for reader in readers:
            reader.join(_GRACE_S)
    if problem:
        raise EstimatorFailedError(command, problem, list(last))


@contextmanager
def _told_to_end() -> Iterator[None]:
    """Whoever is told to end (job schedulers, timeout) first ends what it has started."""

    def stop(number: int, frame: object) -> None:
        raise SystemExit(128 + number)

    if current_thread() is not main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _end(process: subprocess.Popen[str]) -> None:
    """End a process and its group; the process has been waited for afterwards."""
    if sys.platform == "win32":
        if process.poll() is None:
            tree = ["taskkill", "/F", "/T", "/PID", str(process.pid)]
            subprocess.run(tree, capture_output=True, check=False)
        process.wait()
        return
    try:
        deadline = time.monotonic() + _GRACE_S
        alive = _signal_group(process, signal.SIGTERM)
        while alive and time.monotonic() < deadline:
            time.sleep(0.02)
            alive = _signal_group(process, 0)
    finally:  # also where an impatient second Ctrl-C cuts the grace short
        _signal_group(process, signal.SIGKILL)
        process.wait()


def _signal_group(process: subprocess.Popen[str], number: int) -> bool:
    """Send a signal to a process's group; whether anyone was there to get it."""
    process.poll()  # or it would stay in the group as a zombie
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, number)
        return True
    return False
