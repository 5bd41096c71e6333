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
from multiprocessing.connection import wait as wait_for
from pathlib import Path
from threading import Thread, current_thread, main_thread
from typing import Any

from graspcast.errors import EstimatorFailedError, InputError, UnknownNameError
from graspcast.perception import supervisor

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
    processes in its process group. They also end if this process is killed (not on Windows).

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
    process = (_OnWindows if sys.platform == "win32" else _Supervised)(command)
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
            problem = process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        problem, parameters = f"timed out after {timeout_s:g} s", ("timeout_s",)
    finally:
        process.end()
        for reader in readers:
            reader.join(_GRACE_S)
    if problem:
        raise EstimatorFailedError(command, problem, list(last), parameters=parameters)


class _Supervised:
    """A command in a process group of its own, which ends when this process does."""

    def __init__(self, command: Sequence[str]):
        watched, self._held = os.pipe()
        self._report, report = os.pipe()
        program = [sys.executable, "-I", "-S", supervisor.__file__]
        numbers = [str(watched), str(report), str(_GRACE_S)]
        try:
            self._process = _start(
                [*program, *numbers, *command],
                command,
                pass_fds=(watched, report),
                start_new_session=True,
            )
        except BaseException:
            os.close(self._held)
            os.close(self._report)
            raise
        finally:
            os.close(watched)
            os.close(report)
        self.stdout, self.stderr = self._process.stdout, self._process.stderr
        self._said: dict[str, str] = {}

    def wait(self, timeout_s: float | None) -> str:
        """Wait for the command's end and return what went wrong; TimeoutExpired if it is late."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        text = b""
        while "code" not in self._said:
            left = None if deadline is None else max(0.0, deadline - time.monotonic())
            if not wait_for([self._report], left):
                raise subprocess.TimeoutExpired("", timeout_s or 0.0)
            received = os.read(self._report, 4096)
            text += received
            *lines, text = text.split(b"\n")
            self._said |= dict(line.decode(errors="replace").split(" ", 1) for line in lines)
            if not received:
                return "was killed together with its supervising process"
        if "error" in self._said:
            return f"cannot be started ({self._said['error']})"
        return _problem(int(self._said["code"]))

    def end(self) -> None:
        """End the command and its process group."""
        os.close(self._held)
        try:
            self._process.wait(2 * _GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
        finally:  # also after a second Ctrl-C, when the supervisor goes on
            os.close(self._report)
            if "pid" in self._said and self._process.poll() != 0:
                with suppress(ProcessLookupError, PermissionError):
                    os.killpg(int(self._said["pid"]), signal.SIGKILL)


class _OnWindows:  # pragma: no cover - there are no process groups with signals
    """A command, which is ended with its descendants."""

    def __init__(self, command: Sequence[str]):
        self._process = _start(
            command, command, creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
        )
        self.stdout, self.stderr = self._process.stdout, self._process.stderr

    def wait(self, timeout_s: float | None) -> str:
        return _problem(self._process.wait(timeout_s))

    def end(self) -> None:
        if self._process.poll() is None:
            tree = ["taskkill", "/F", "/T", "/PID", str(self._process.pid)]
            subprocess.run(tree, capture_output=True, check=False)
        self._process.wait()


def _problem(code: int) -> str:
    if code < 0:
        return f"was killed by signal {-code}"
    return f"failed with exit code {code}" if code else ""


def _start(program: Sequence[str], command: Sequence[str], **how: Any) -> subprocess.Popen[str]:
    """Start a program for a command."""
    try:
        return subprocess.Popen(
            program,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            **how,
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
