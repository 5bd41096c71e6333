"""The verb ``serve``: verdicts over HTTP."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from graspcast.cli.decision_options import add_models, add_robot_policy, add_threshold, watcher_of
from graspcast.cli.options import Verbs, new_verb
from graspcast.cli.progress import waiting
from graspcast.errors import InputError

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``serve``."""
    verb = new_verb(
        verbs,
        "serve",
        _serve,
        "verdicts over HTTP",
        "Answer HTTP requests: all estimates of a frame in, a decision on every instance out, and\n"
        "outcomes into the log. GET /openapi.json describes every route. It listens on this\n"
        "machine alone, unless the environment variable GRASPCAST_TOKEN holds a token, which\n"
        "clients then show. SIGTERM and Ctrl-C stop it when all accepted requests are answered.\n"
        "It logs one JSON object a line on standard error.",
    )
    add_models(verb)
    add_threshold(verb)
    add_robot_policy(verb)
    verb.add_argument(
        "--log",
        metavar="PATH",
        type=Path,
        help="keep every decision and outcome in this log; it is made if it does not exist",
    )
    _add_place(verb)


def _add_place(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--host", metavar="NAME", default="127.0.0.1", help="where to listen (default: 127.0.0.1)"
    )
    verb.add_argument(
        "--port",
        metavar="N",
        type=_port,
        default=8000,
        help="0 for any that is free (default: 8000)",
    )
    verb.add_argument(
        "--quiet", action="store_true", help="log no requests, but what fails, start and stop"
    )


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"a number from 0 to 65535 is needed, not {text!r}")
    return int(text)


def _serve(options: argparse.Namespace) -> None:
    from graspcast.io.extras import require

    require("serve")
    from graspcast.attempt_log.log import AttemptLog
    from graspcast.guarantees.certificate import Certificate
    from graspcast.guarantees.log_monitor import LogMonitor
    from graspcast.service.access import token_from
    from graspcast.service.logs import log_to
    from graspcast.service.server import listen, serve

    if options.threshold is not None and options.certificate:
        raise InputError("--threshold and --certificate exclude each other; give one")
    token = token_from()
    with ExitStack() as stack:
        # Standard error has the log, JSON lines alone.
        stack.enter_context(waiting())
        # What is refused at once is not found out after the models are read.
        listener = stack.enter_context(listen(options.host, options.port, token))
        log = stack.enter_context(AttemptLog.open(options.log)) if options.log else None
        certificates = [Certificate.load(path) for path in options.certificate]
        watcher = watcher_of(options, certificates, log=log, source="service")
        monitor = None
        if log is not None and certificates and certificates[0].overall.threshold is not None:
            monitor = partial(LogMonitor.of(certificates[0]).update, log)
        log_to(requests=not options.quiet)
        serve(watcher, listener, token=token, monitor=monitor)
