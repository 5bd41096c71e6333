"""Parsing of request bodies: JSON that is strict, and fits a schema, or a refusal that says where.

What JSON does not know (NaN, Infinity) and what is ambiguous (a name that comes twice in an object)
is refused.
"""

from __future__ import annotations

import json
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from graspcast.service.replies import RefusedError

__all__ = ["parsed"]

Schema = TypeVar("Schema", bound=BaseModel)
_MOST_ERRORS = 10
_MOST_NAME = 60


def parsed(body: bytes, schema: type[Schema]) -> Schema:
    """Parse a request's body.

    Parameters
    ----------
    body
        JSON in UTF-8.
    schema
        What it must fit.

    Raises
    ------
    RefusedError
        With status 400 for what is no JSON, and 422 for what does not fit the schema.
    """
    try:
        content = json.loads(
            body.decode("utf-8"), object_pairs_hook=_unique, parse_constant=_no_number
        )
    except UnicodeDecodeError as error:
        raise RefusedError(400, f"the body is not UTF-8 (byte {error.start})") from error
    except RecursionError as error:
        raise RefusedError(400, "the body is nested too deeply") from error
    except ValueError as error:
        raise RefusedError(400, f"the body is not JSON: {error}") from error
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        found = error.errors(include_url=False, include_context=False, include_input=False)
        errors = [(_place(e["loc"]), e["msg"]) for e in found[:_MOST_ERRORS]]
        more = len(found) - len(errors)
        raise RefusedError(
            422,
            "the body does not fit the schema: "
            + "; ".join(f"{where}: {what}" for where, what in errors)
            + (f"; and {more} more" if more else ""),
            errors=errors,
        ) from error


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"the name {twice[:_MOST_NAME]!r} comes twice in an object")
    return found


def _no_number(text: str) -> None:
    raise ValueError(f"{text} is no number of JSON")


def _place(loc: tuple[int | str, ...]) -> str:
    return ".".join(str(part)[:_MOST_NAME] for part in loc) or "the body"
