"""The command line: one file a verb, with its options and what it prints."""

from __future__ import annotations

import argparse
import io
import os
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import TextIO

from graspcast._version import __version__
from graspcast.cli import (
    add_object,
    certify,
    check_gripper,
    compare,
    convert,
    demo,
    doctor,
    errors,
    estimate,
    evaluate,
    fetch,
    fit_grasp,
    fuse,
    grasps,
    import_release,
    log,
    monitor,
    overlay,
    predict,
    propose_grasps,
    render,
    report,
    reproduce,
    rosbag,
    score,
    serve,
    simulate,
    tolerance,
    train,
    train_estimator,
    validate_sim,
    view,
    watch,
)
from graspcast.cli.console import logged_as_notes
from graspcast.cli.options import check_outputs
from graspcast.cli.progress import running
from graspcast.errors import GraspcastError
from graspcast.io.address_space import check_address_space

__all__ = ["main", "parser", "verb_parsers"]

# In the order of --help.
_VERBS = (
    demo,
    doctor,
    render,
    estimate,
    train_estimator,
    convert,
    errors,
    fuse,
    train,
    predict,
    score,
    report,
    compare,
    certify,
    monitor,
    log,
    serve,
    evaluate,
    reproduce,
    add_object,
    propose_grasps,
    simulate,
    fit_grasp,
    validate_sim,
    check_gripper,
    grasps,
    tolerance,
    watch,
    view,
    overlay,
    rosbag,
    fetch,
    import_release,
)

_DESCRIPTION = """\
Several RGB pose estimators look at the same object; graspcast says how likely the grasp that one
of them would guide is to succeed, and whether to attempt it.
"""


def parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    top = argparse.ArgumentParser(prog="graspcast", description=_DESCRIPTION)
    top.add_argument("--version", action="version", version=f"graspcast {__version__}")
    verbs = top.add_subparsers(title="verbs", dest="verb", metavar="VERB", required=True)
    for module in _VERBS:
        module.add(verbs)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code.

    0 done, 1 errors found by ``doctor``, 2 a mistake in the input, 3 an alarm of ``monitor``,
    130 interrupted, 141 nobody reads the output any more.
    """
    for stream in (sys.stdout, sys.stderr):
        # A terminal or pipe of another encoding than UTF-8 shows "?" for what it lacks.
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="replace")
    arguments_parser = parser()
    options = arguments_parser.parse_args(arguments)
    try:
        check_address_space()
        check_outputs(options)
        with running(options.verb), logged_as_notes():
            code = options.run(options) or 0
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except GraspcastError as error:
        _tell(options.verb, _with_options(arguments_parser, options.verb, error))
        return 2
    except KeyboardInterrupt:
        _tell(options.verb, "interrupted")
        return 130
    except BrokenPipeError:
        _discard_output()
        return 141
    except (OSError, MemoryError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and "start new thread" not in str(error):
            raise
        what = "memory ran out" if isinstance(error, MemoryError) else str(error)
        if isinstance(error, OSError) and error.errno is not None and error.filename is None:
            # Every file is opened by its name; what has none is where the output goes.
            what = f"standard output or error cannot be written ({error.strerror})"
        _tell(options.verb, what)
        _discard_output()
        return 2


def _tell(verb: str, text: str) -> None:
    """Print a message on standard error; where that cannot be written, the exit code is left."""
    try:
        print(f"graspcast {verb}: {text}", file=sys.stderr, flush=True)  # noqa: T201
    except OSError:
        _discard(sys.stderr)


def _discard_output() -> None:
    """Keep Python from writing what is left of the output when it exits, which fails again."""
    _discard(sys.stdout)


def _discard(stream: TextIO | None) -> None:
    with suppress(OSError, ValueError, AttributeError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())  # type: ignore[union-attr]
        os.close(null)


def verb_parsers(top: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parser of each verb."""
    (verbs,) = (a for a in top._actions if isinstance(a, argparse._SubParsersAction))
    return dict(verbs.choices)


def _with_options(top: argparse.ArgumentParser, verb: str, error: GraspcastError) -> str:
    """Return an error's message with the verb's options that belong to its parameters.

    As `` (see --a, --b)`` at the end; a value of the wrong kind is the option's, and no function's.
    """
    actions = verb_parsers(top)[verb]._actions
    by_name = {a.dest: a.option_strings[-1] for a in actions if a.option_strings}
    names = [name for name in error.parameters if name in by_name]
    text = str(error)
    if len(names) == 1:
        of_function = re.fullmatch(rf"[A-Za-z_][\w.]*: {names[0]} (should be .*)", text, re.DOTALL)
        if of_function:
            return f"{by_name[names[0]]} {of_function[1]}"
    options = [by_name[name] for name in names]
    return text + (f" (see {', '.join(options)})" if options else "")
