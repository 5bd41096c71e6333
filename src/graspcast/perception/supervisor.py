"""Supervisor of an external command: a small program that ends it when graspcast ends.

graspcast may be killed, and then cannot stop the command that it runs. So it starts this program,
which starts the command in a process group and watches a pipe. The pipe closes when graspcast wants
the command to end, or when it has ended itself, however; the program then ends the whole group.

Run as ``supervisor.py WATCHED REPORT GRACE_S COMMAND ...``; the first two are the numbers of open
pipes. Lines written to ``REPORT``: ``pid N`` of the command, then ``error TEXT`` if it could not be
started, or ``code N`` when it has ended (-N if by signal N). Only the standard library is imported,
and little of it, because it is run by ``python -I -S``.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from contextlib import suppress

__all__ = ["main"]


def main() -> None:
    """Run the command, and end its process group when the pipe closes."""
    watched, report, grace_s, command = (
        int(sys.argv[1]),
        int(sys.argv[2]),
        float(sys.argv[3]),
        sys.argv[4:],
    )
    for handle in (watched, report):
        os.set_inheritable(handle, False)  # so that the command does not hold them open
    die_with_parent = _death_signal()
    pid = os.fork()
    if not pid:  # pragma: no cover - in a fork, as all below that is not covered
        _become(command, report, die_with_parent)
    with suppress(ProcessLookupError, PermissionError):
        os.setpgid(pid, pid)  # here too, so that it is done whoever is first
    _say(report, f"pid {pid}")
    if not os.fork():  # pragma: no cover - waits for the pipe, and the parent for the command
        os.close(report)
        _close_output()
        os.read(watched, 1)
        _end_group(pid, grace_s)
        os._exit(0)
    _, status = os.waitpid(pid, 0)
    _say(report, f"code {os.waitstatus_to_exitcode(status)}")
    _close_output()
    os.read(watched, 1)
    os.wait()


def _become(command: list[str], report: int, die_with_parent: object) -> None:  # pragma: no cover
    try:
        os.setpgid(0, 0)
        # Python ignores these, and what is ignored stays so in the program that follows.
        for number in (signal.SIGPIPE, signal.SIGXFSZ):
            signal.signal(number, signal.SIG_DFL)
        if callable(die_with_parent):
            die_with_parent()
        os.execvp(command[0], command)
    except (OSError, ValueError) as error:
        text = error.strerror if isinstance(error, OSError) else error
        _say(report, f"error {text}")
    os._exit(127)


def _death_signal() -> object:
    """Return a function after which the kernel kills this process with its parent (on Linux)."""
    if not sys.platform.startswith("linux"):
        return None
    with suppress(ImportError, OSError, AttributeError):
        import ctypes

        prctl = ctypes.CDLL(None).prctl
        return lambda: prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    return None


def _end_group(group: int, grace_s: float) -> None:  # pragma: no cover
    deadline = time.monotonic() + grace_s
    alive = _signal_group(group, signal.SIGTERM)
    while alive and time.monotonic() < deadline:
        time.sleep(0.02)
        alive = _signal_group(group, 0)
    _signal_group(group, signal.SIGKILL)


def _signal_group(group: int, number: int) -> bool:  # pragma: no cover
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(group, number)
        return True
    return False


def _say(report: int, line: str) -> None:
    with suppress(OSError):  # graspcast is gone
        os.write(report, f"{line}\n".encode())


def _close_output() -> None:
    """Close the command's output here, so that its readers see its end."""
    for handle in (1, 2):
        with suppress(OSError):
            os.close(handle)


if __name__ == "__main__":
    main()
