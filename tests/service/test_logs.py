from __future__ import annotations

import io
import json
import logging
from collections.abc import Iterator

import pytest

from graspcast.service.logs import REQUESTS, log_to

NAMES = ("graspcast.service", REQUESTS, "uvicorn")


@pytest.fixture(autouse=True)
def loggers_as_before() -> Iterator[None]:
    before = [(logger, list(logger.handlers), logger.level, logger.propagate) for logger in LOGGERS]
    yield
    for logger, handlers, level, propagate in before:
        logger.handlers[:], logger.propagate = handlers, propagate
        logger.setLevel(level)


LOGGERS = [logging.getLogger(name) for name in NAMES]


def test_a_line_is_a_json_object() -> None:
    stream = io.StringIO()
    log_to(stream)
    logger = logging.getLogger("graspcast.service.edge")
    logger.info("request", extra={"fields": {"route": "/frames", "status": 200}})
    logging.getLogger("uvicorn.error").warning("odd\n%s", "thing")
    first, second = map(json.loads, stream.getvalue().splitlines())
    assert (first["event"], first["route"], first["status"]) == ("request", "/frames", 200)
    assert first["time"].endswith("+00:00")
    assert (second["level"], second["event"]) == ("warning", "odd\nthing")


def test_a_fault_is_told_with_its_traceback() -> None:
    stream = io.StringIO()
    log_to(stream, requests=False)
    logging.getLogger(REQUESTS).info("not told")
    logger = logging.getLogger("graspcast.service")
    try:
        raise ValueError("why")
    except ValueError:
        logger.exception("failed")
    (line,) = map(json.loads, stream.getvalue().splitlines())
    assert "ValueError: why" in line["traceback"]
