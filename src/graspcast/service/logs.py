"""Logs of the service: one JSON object a line, without payloads and tokens."""

from __future__ import annotations

import json
import logging
import sys
from datetime import UTC, datetime
from io import TextIOBase
from typing import Any

__all__ = ["REQUESTS", "JsonLines", "log_to"]

REQUESTS = "graspcast.service.edge"
"""The logger of requests."""

_MOST_TEXT = 2000


class JsonLines(logging.Formatter):
    """Formats a record as a JSON object: time, level, event, and what it carries as ``fields``."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        fields: dict[str, Any] = getattr(record, "fields", {})
        content = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "event": record.getMessage()[:_MOST_TEXT],
            **fields,
        }
        if record.exc_info:
            content["traceback"] = self.formatException(record.exc_info)[-2 * _MOST_TEXT :]
        return json.dumps(content)


def log_to(stream: TextIOBase | None = None, *, requests: bool = True) -> None:
    """Log what the service and its server do to a stream.

    Parameters
    ----------
    stream
        Where to; standard error if None.
    requests
        Whether to log a line for every request.
    """
    handler = logging.StreamHandler(stream or sys.stderr)
    handler.setFormatter(JsonLines())
    for name in ("graspcast.service", "uvicorn"):
        logger = logging.getLogger(name)
        logger.handlers[:] = [handler]
        logger.setLevel(logging.INFO)
        logger.propagate = False
    logging.getLogger(REQUESTS).setLevel(logging.INFO if requests else logging.WARNING)
