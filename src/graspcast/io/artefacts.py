"""Artefacts: JSON files that graspcast writes and reads again, checked by a digest."""

from __future__ import annotations

import json
from collections.abc import Mapping
from os import PathLike
from typing import Any

from graspcast.errors import FormatError
from graspcast.io.hashing import canonical_json, sha256
from graspcast.io.json import read_json, write_json

__all__ = ["artefact_digest", "read_artefact", "without_digest", "write_artefact"]

_DIGEST = "sha256"


def write_artefact(
    path: str | PathLike[str], content: Mapping[str, Any], *, indent: int = 2
) -> None:
    """Write an object as JSON, atomically, with the digest of its content as one more entry.

    Parameters
    ----------
    path
        The file.
    content
        What :func:`graspcast.io.json.write_json` writes. ``sha256`` is the digest's own key.
    indent
        Spaces an indentation level.

    Raises
    ------
    InputError
        If a number is NaN or infinite, or the file cannot be written.
    """
    write_json(path, {**content, _DIGEST: artefact_digest(content)}, indent=indent)


def read_artefact(
    path: str | PathLike[str], remedy: str, *, parameters: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Read what :func:`write_artefact` wrote, without the digest.

    The digest is of the values: a file that is indented in another way holds the same.

    Parameters
    ----------
    path
        The file.
    remedy
        What to do about a file that is no JSON object, or without a digest or with a wrong one, as
        ``"certify again"``.
    parameters
        As for :class:`graspcast.errors.GraspcastError`.

    Raises
    ------
    FormatError
        If it cannot be read, is not a JSON object, has no digest, or another one.
    """
    try:
        content: dict[str, Any] = read_json(path, dict)
    except FormatError as error:
        raise FormatError(
            path, f"{error.problem}; {remedy}", where=error.where, parameters=parameters
        ) from error
    stated = content.pop(_DIGEST, None)
    if stated is None:
        raise without_digest(path, remedy, parameters=parameters)
    if stated != artefact_digest(content):
        raise FormatError(
            path,
            f"is damaged or was edited: its content does not match its digest; {remedy}",
            parameters=parameters,
        )
    return content


def without_digest(
    path: str | PathLike[str], remedy: str, *, parameters: tuple[str, ...] = ()
) -> FormatError:
    """Return the error that a file carries no digest; arguments as of :func:`read_artefact`."""
    return FormatError(
        path,
        "has no digest: it is damaged, was written by a former version, or is something else; "
        + remedy,
        parameters=parameters,
    )


def artefact_digest(content: Mapping[str, Any]) -> str:
    """Compute the digest of an object without a digest: of its values as JSON gives them back."""
    # Keys become text, and tuples lists.
    return sha256(canonical_json(json.loads(json.dumps(content))))
