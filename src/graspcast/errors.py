"""Every error that graspcast raises on purpose.

::

    GraspcastError
    ├── InputError            something from outside is wrong: a file, a value, an argument
    │   ├── FormatError       a file does not hold what its format promises
    │   ├── UnknownNameError  a name that nobody knows; the message lists those that are known
    │   └── MismatchError     two inputs are each fine, but do not belong together
    ├── ExtraMissingError     an optional dependency is not installed; the message has the pip line
    ├── EstimatorFailedError  an external estimator's command went wrong; with its last words
    ├── CampaignStoppedError  a campaign could not go on; what it has computed is kept
    └── WorkerLostError       a process that computed trials has died

The command line turns each of them into one message and exit code 2. A message names what is wrong
and what is available; ``parameters`` names, as in Python, the arguments by which to mend it, and
the command line adds its options of the same names.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from os import PathLike

__all__ = [
    "CampaignStoppedError",
    "EstimatorFailedError",
    "ExtraMissingError",
    "FormatError",
    "GraspcastError",
    "InputError",
    "MismatchError",
    "UnknownNameError",
    "WorkerLostError",
]


class GraspcastError(Exception):
    """The base of every error that graspcast raises on purpose.

    Parameters
    ----------
    message
        What is wrong, where, what is available, and what to do.
    parameters
        Names of the Python parameters by which to mend it.
    """

    def __init__(self, message: str, *, parameters: Sequence[str] = ()):
        super().__init__(message)
        self.parameters = tuple(parameters)


class InputError(GraspcastError):
    """Something that came from outside is wrong; the message says what, where, and the remedy."""


class FormatError(InputError):
    """A file does not hold what its format promises.

    Parameters
    ----------
    path
        The file.
    problem
        What is wrong and what to do, as one or two sentences.
    where
        A row, a key or a line in the file, where it is known.
    parameters
        As for :class:`GraspcastError`.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        problem: str,
        *,
        where: str | None = None,
        parameters: Sequence[str] = (),
    ):
        self.path = path
        self.problem = problem
        self.where = where
        super().__init__(f"{path}{f', {where}' if where else ''}: {problem}", parameters=parameters)


class UnknownNameError(InputError):
    """A name that is not among the known ones.

    Parameters
    ----------
    kind
        What the name should have named, for example ``"estimator"``.
    name
        The name that was given.
    known
        The names that exist.
    hint
        One more sentence on what to do.
    parameters
        As for :class:`GraspcastError`.
    """

    def __init__(
        self,
        kind: str,
        name: object,
        known: Iterable[object],
        *,
        hint: str = "",
        parameters: Sequence[str] = (),
    ):
        names = [str(k) for k in known]
        near = get_close_matches(str(name), names, n=1)
        message = f"unknown {kind} {str(name)!r}"
        message += f" (did you mean {near[0]!r}?)" if near else ""
        message += f"; known: {', '.join(names) if names else 'none'}"
        super().__init__(message + (f". {hint}" if hint else ""), parameters=parameters)


class MismatchError(InputError):
    """Two inputs are each fine, but do not belong together."""


class EstimatorFailedError(GraspcastError):
    """An external estimator's command went wrong.

    Parameters
    ----------
    command
        The program and its arguments.
    problem
        What happened to it.
    last_lines
        The end of what it wrote to standard error.
    """

    def __init__(self, command: Sequence[str], problem: str, last_lines: Iterable[str] = ()):
        message = f"the command {shlex.join(command)} {problem}"
        said = "".join(f"\n  {line}" for line in last_lines)
        super().__init__(
            message + (f"; the last that it wrote to standard error:{said}" if said else "")
        )


class CampaignStoppedError(GraspcastError):
    """A campaign could not go on; what it has computed is kept, and it can be gone on with."""


class WorkerLostError(GraspcastError):
    """A process that computed trials has died."""


class ExtraMissingError(GraspcastError):
    """An optional dependency is not installed.

    Parameters
    ----------
    package
        The package that could not be imported.
    extra
        The extra of graspcast that brings it.
    """

    def __init__(self, package: str, extra: str):
        super().__init__(
            f"this needs {package}, which is not installed: pip install 'graspcast[{extra}]'"
        )
