"""SHA-256 digests of bytes, text, arrays, JSON values and files."""

from __future__ import annotations

import hashlib
import json
from os import PathLike
from typing import Any

import numpy as np
from numpy import ndarray

from graspcast.io.reading import read_bytes

__all__ = ["canonical_json", "sha256", "sha256_of_file"]


def sha256(*parts: bytes | str | ndarray) -> str:
    """Compute the SHA-256 digest of the concatenation of bytes, texts and arrays.

    Parameters
    ----------
    *parts
        Text is encoded as UTF-8. Of an array the numbers are hashed, in row-major order and in the
        array's own type; its shape is not.

    Returns
    -------
    64 hexadecimal digits.
    """
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, str):
            digest.update(part.encode())
        else:
            digest.update(part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()


def sha256_of_file(path: str | PathLike[str]) -> str:
    """Compute the SHA-256 digest of a file's bytes, as hexadecimal digits.

    Raises
    ------
    FormatError
        If the file cannot be read.
    """
    return sha256(read_bytes(path))


def canonical_json(value: Any) -> str:
    """Encode a value as JSON with sorted keys, so that equal values give equal text."""
    return json.dumps(value, sort_keys=True)
