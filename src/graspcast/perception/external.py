"""External pose estimators: a command is run in a separate process.

The command may use any Python, libraries and GPU; it exchanges only files with graspcast.
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
"""Seconds between SIGTERM and SIGKILL."""


def command_line(template: str, paths: Mapping[str, Path]) -> list[str]:
    """Split a command template into words and fill in its placeholders.

    The template is split as a shell would split it, then filled in, so a path with spaces stays
    one word. No shell is involved: ``|``, ``>`` and ``$NAME`` have no special meaning.

    Parameters
    ----------
    template
        For example ``"python infer.py --images {bop} --save {out}"``.
    paths
        The value of each placeholder; ``out`` is one of them.

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
        raise InputError(
            f"{template!r} is not a command: {error}", parameters=("estimator",)
        ) from error
    used = {name for word in words for name in _PLACEHOLDER.findall(word)}
    for name in sorted(used - set(paths)):
        known = [f"{{{known}}}" for known in paths]
        raise UnknownNameError("placeholder", f"{{{name}}}", known, parameters=("estimator",))
    if "out" not in used:
        raise InputError(
            f"{template!r} has no {{out}}, the file to which the command writes its poses",
            parameters=("estimator",),
        )
    return [_PLACEHOLDER.sub(lambda match: str(paths[match.group(1)]), word) for word in words]


def run_command(
    command: Sequence[str],
    *,
    timeout_s: float | None = None,
    on_output: Callable[[str], None] | None = None,
) -> None:
    """Run a command and wait for it.

    When this function returns or raises (on Ctrl-C too), the command has ended, and so have all
    processes in its process group.

    Parameters
    ----------
    command
        The program and its arguments.
    timeout_s
        Stop the command after this time, seconds.
    on_output
        Called with each line of its output, from other threads.

    Raises
    ------
    EstimatorFailedError
        If it cannot be started, times out, or its exit code is not 0; with the last lines of its
        standard error.
    """
    process = _start(command)
    last: deque[str] = deque(maxlen=_QUOTED_LINES)

    def forward(stream: TextIOBase, keep: bool) -> None:
        with stream:
            for line in stream:
                if line := line.strip():
                    if on_output:
                        on_output(line)
                    if keep:
                        last.append(line)

    streams = ((process.stdout, False), (process.stderr, True))
    readers = [Thread(target=forward, args=pair, daemon=True) for pair in streams]
    for reader in readers:
        reader.start()
    problem = ""
    parameters: tuple[str, ...] = ()
    try:
        with _stop_on_sigterm():
            code = process.wait(timeout_s)
        if code:
            problem = (
                f"was killed by signal {-code}" if code < 0 else f"failed with exit code {code}"
            )
    except subprocess.TimeoutExpired:
        problem, parameters = f"timed out after {timeout_s:g} s", ("timeout_s",)
    finally:
        _end(process)
        for reader in readers:
            reader.join(_GRACE_S)
    if problem:
        raise EstimatorFailedError(command, problem, list(last), parameters=parameters)


def _start(command: Sequence[str]) -> subprocess.Popen[str]:
    """Start a command in a new process group."""
    own_group: dict[str, Any] = {"start_new_session": True}
    if sys.platform == "win32":
        own_group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    try:
        return subprocess.Popen(
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


@contextmanager
def _stop_on_sigterm() -> Iterator[None]:
    """Raise SystemExit on SIGTERM (from a job scheduler, for example), so that cleanup runs."""

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
    """Stop a process and its process group, and wait for the process."""
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
    finally:  # also after a second Ctrl-C
        _signal_group(process, signal.SIGKILL)
        process.wait()


def _signal_group(process: subprocess.Popen[str], number: int) -> bool:
    """Send a signal to a process group; return whether it still had processes."""
    process.poll()  # otherwise it stays in the group as a zombie
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, number)
        return True
    return False
