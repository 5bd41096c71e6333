"""The exceptions that graspcast raises.

::

    GraspcastError
    ├── InputError            an input is wrong: a file, a value, an argument
    │   ├── FormatError       a file does not follow its format
    │   ├── UnknownNameError  a name is not known; the message lists the known names
    │   ├── MismatchError     two inputs are valid, but do not belong together
    │   ├── UnknownEpisodeError  an episode is not known (any more); the message says why
    │   └── TransformMissingError  no transform between two frames is known at a time
    │       └── TransformNotYetError  it may still come: nothing as late has arrived
    ├── InstallationError     MuJoCo is not installed, or broken; the message says how to mend it
    ├── ExtraMissingError     an optional dependency is not installed; the message has the pip line
    ├── EstimatorFailedError  an external estimator's command failed; with the end of its stderr
    ├── DownloadError         a file could not be downloaded; what has arrived is kept, and resumed
    ├── CampaignStoppedError  a campaign stopped early; its outcomes are kept, and it can be resumed
    └── WorkerLostError       a worker process that computed trials has died

``TrainingDataWarning``, a UserWarning, is no error: training went well, but on few data.

The command line prints each of them as one message, and exits with code 2. A message names what is
wrong and what is available; ``parameters`` holds the names of the Python parameters to change, and
the command line adds its options of the same names.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from os import PathLike

__all__ = [
    "CampaignStoppedError",
    "DownloadError",
    "EstimatorFailedError",
    "ExtraMissingError",
    "FormatError",
    "GraspcastError",
    "InputError",
    "InstallationError",
    "MismatchError",
    "TrainingDataWarning",
    "TransformMissingError",
    "TransformNotYetError",
    "UnknownEpisodeError",
    "UnknownNameError",
    "WorkerLostError",
]


class GraspcastError(Exception):
    """The base class of graspcast's exceptions.

    Parameters
    ----------
    message
        What is wrong, where, what is available, and what to do.
    parameters
        Names of the Python parameters to change.
    """

    def __init__(self, message: str, *, parameters: Sequence[str] = ()):
        super().__init__(message)
        self.parameters = tuple(parameters)


class InputError(GraspcastError):
    """An input is wrong; the message says what, where, and the remedy."""


class FormatError(InputError):
    """A file does not follow its format.

    Parameters
    ----------
    path
        The file.
    problem
        What is wrong and what to do, as one or two sentences.
    where
        A row, a key or a line in the file, if known.
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
    """A name is not among the known ones.

    Parameters
    ----------
    kind
        The kind of thing that was named, for example ``"estimator"``.
    name
        The unknown name.
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
    """Two inputs are valid, but do not belong together."""


class UnknownEpisodeError(InputError):
    """An episode is not known: it never was, has expired, was forgotten or made room."""


class EstimatorFailedError(GraspcastError):
    """An external estimator's command failed.

    Parameters
    ----------
    command
        The program and its arguments.
    problem
        What went wrong, for example ``"timed out after 30 s"``.
    last_lines
        The last lines of its standard error.
    parameters
        As for :class:`GraspcastError`.
    """

    def __init__(
        self,
        command: Sequence[str],
        problem: str,
        last_lines: Iterable[str] = (),
        *,
        parameters: Sequence[str] = (),
    ):
        message = f"the command {shlex.join(command)} {problem}"
        if quoted := "".join(f"\n  {line}" for line in last_lines):
            message += f"; the last lines of its standard error are:{quoted}"
        super().__init__(message, parameters=parameters)


class DownloadError(GraspcastError):
    """A file could not be downloaded, or is not the one that was expected."""


class CampaignStoppedError(GraspcastError):
    """A campaign stopped early; its outcomes are kept, and it can be resumed."""


class WorkerLostError(GraspcastError):
    """A worker process that computed trials has died."""


class TransformMissingError(InputError):
    """There is no transform between two frames at a time; the message says why."""


class TransformNotYetError(TransformMissingError):
    """The transform is not known yet: frames are not connected so far, or only until earlier."""


class InstallationError(GraspcastError):
    """A package that is always needed is not installed, or its files do not fit together."""


class ExtraMissingError(GraspcastError):
    """An optional dependency is not installed.

    Parameters
    ----------
    package
        The package that could not be imported.
    extra
        The extra of graspcast that installs it.
    parameters
        As for :class:`GraspcastError`.
    """

    def __init__(self, package: str, extra: str, *, parameters: Sequence[str] = ()):
        super().__init__(
            f"this needs {package}, which is not installed: pip install 'graspcast[{extra}]'",
            parameters=parameters,
        )


class TrainingDataWarning(UserWarning):
    """A forecaster was trained on data too few for some of its uses; the text says which."""
