"""Mutations of valid files, for ``fuzz.py``: of bytes, text, JSON and arrays."""

from __future__ import annotations

import io
import json
import re
from random import Random
from typing import Any

import numpy as np

from graspcast.io.arrays import arrays_digest
from graspcast.io.artefacts import artefact_digest

NUMBERS = [
    *("0", "-1", "-0", "1e400", "-1e308", "1e-320", "nan", "inf", "-Infinity", "0.5", "1000"),
    *("2147483648", "-9223372036854775809", "18446744073709551616", "9" * 400, "9" * 5000),
    *("1_000", "٣", "0x10", "1e", "", "true", "null", "1,5", "007", "+1", " 1 ", "²", "½"),
]
VALUES: list[Any] = [
    *(None, True, False, 0, -1, 1, 2**31, 2**63, 2**64, 10**400, -(10**5000), 1.5, -0.0, 1e308),
    *(1e-320, float("nan"), float("inf"), "", "0", "00", "é", "\0", "a" * 3000, "\ud800", "²"),
    *([], {}, [[]], [None], {"": None}, [1, 2, 3], [0.0] * 9, {"a": {"b": []}}),
]
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_BYTES = [b"\0", b"\xff", b"\n", b"\r", b'"', b"'", b",", b"{", b"[", b"\xef\xbb\xbf", b"\x80" * 8]
_TYPES = ["<f8", "<f4", "<i8", "<i4", "|u1", "|b1", ">f8", "<U3", "<c16", "|S4", "<M8[s]"]


def of_bytes(content: bytes, random: Random) -> bytes:
    """Flip, replace, cut, repeat, insert or swap bytes, once or a few times."""
    out = bytearray(content)
    for _ in range(random.choice((1, 1, 1, 2, 4, 16))):
        size = len(out)
        if not size:
            return bytes(out)
        at, kind = random.randrange(size), random.randrange(8)
        end = min(size, at + random.choice((1, 2, 4, 8, 64, 512)))
        if kind <= 1:
            out[at] ^= 1 << random.randrange(8)
        elif kind == 2:
            out[at] = random.randrange(256)
        elif kind == 3:
            del out[at:end]
        elif kind == 4:
            out[at:at] = out[at:end] * random.choice((1, 2, 50))
        elif kind == 5:
            out[at:at] = random.choice(_BYTES)
        elif kind == 6:
            out[at:end] = bytes(random.choice((0, 255)) for _ in range(end - at))
        elif random.random() < 0.2:
            del out[at:]
    return bytes(out)


def of_text(content: bytes, random: Random) -> bytes:
    """Replace numbers and words, or move, drop and repeat lines and fields."""
    kind = random.randrange(6)
    if kind <= 2:
        found = list(_NUMBER.finditer(content))
        for match in sorted(
            random.sample(found, min(len(found), random.choice((1, 1, 3)))),
            key=lambda m: -m.start(),
        ):
            new = random.choice(NUMBERS).encode()
            content = content[: match.start()] + new + content[match.end() :]
        return content
    separator = random.choice((b"\n", b"\n", b",", b" ", b"=", b"\t", b'"', b"<", b"/"))
    parts = content.split(separator)
    at = random.randrange(len(parts))
    if kind == 3:
        parts.insert(at, random.choice(parts))
    elif kind == 4:
        del parts[at]
    else:
        other = random.randrange(len(parts))
        parts[at], parts[other] = parts[other], parts[at]
    return separator.join(parts)


def of_json(content: bytes, random: Random, *, digest: bool = False) -> bytes:
    """Change values and keys of JSON; with a digest, give most of them a new one."""
    value = json.loads(content)
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        value = _changed(value, random)
    if digest and isinstance(value, dict) and random.random() < 0.9:
        value.pop("sha256", None)
        try:
            value["sha256"] = artefact_digest(value)
        except (ValueError, UnicodeError):  # a number or a text that has no canonical form
            return content
    try:
        text = json.dumps(value)
    except ValueError:  # a whole number of more digits than Python prints
        return content
    if random.random() < 0.03 and text.startswith("{"):
        text = text[:1] + text[1:].split(",")[0] + "," + text[1:]
    return text.encode("utf-8", "surrogatepass")


def _changed(value: Any, random: Random) -> Any:
    """Return a value with one change somewhere in it."""
    if isinstance(value, dict) and value and random.random() < 0.9:
        key = random.choice(list(value))
        how = random.random()
        if how < 0.75:
            return {**value, key: _changed(value[key], random)}
        rest = {k: v for k, v in value.items() if k != key}
        if how < 0.85:
            return rest
        if how < 0.95:
            return {**rest, random.choice((*NUMBERS[:20], "a", key + " ")): value[key]}
        return {**value, random.choice(list(value)): value[key]}
    if isinstance(value, list) and value and random.random() < 0.9:
        at, how, out = random.randrange(len(value)), random.random(), list(value)
        if how < 0.75:
            out[at] = _changed(out[at], random)
        elif how < 0.85:
            del out[at]
        else:
            out.insert(random.randrange(len(out)), out[at])
        return out
    # A whole number may be too large to divide.
    if isinstance(value, int | float) and abs(value) < 1e300 and random.random() < 0.4:
        return random.choice((-value, value * 1000, value / 1000, str(value), value + 1))
    return random.choice(VALUES)


def of_arrays(content: bytes, random: Random) -> bytes:
    """Change arrays of an npz file; most results carry a digest that is right."""
    with np.load(io.BytesIO(content), allow_pickle=False) as data:
        arrays = {name: data[name] for name in data.files if name != "sha256"}
    for _ in range(random.choice((1, 1, 2, 4))):
        if not arrays:
            break
        name = random.choice(list(arrays))
        _change_array(arrays, name, random)
    if random.random() < 0.95:
        arrays["sha256"] = np.array(arrays_digest(arrays))
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def _change_array(arrays: dict[str, Any], name: str, random: Random) -> None:
    array, kind = arrays[name].copy(), random.randrange(9)
    if array.dtype.kind == "U" and array.ndim == 0 and kind < 7:
        text = str(array)
        try:
            changed = of_json(text.encode(), random).decode("utf-8", "surrogatepass")
        except ValueError:
            changed = of_text(text.encode(), random).decode("utf-8", "replace")
        arrays[name] = np.array(changed)
    elif kind <= 3 and array.size and array.dtype.kind in "iufb":
        flat, at = array.reshape(-1), random.randrange(array.size)
        extremes = (0, 1, -1, 2**31 - 1, -(2**31), flat[at] + 1, flat[at] - 1, 2**62, len(flat))
        value = random.choice(extremes)
        if array.dtype.kind == "f" and random.random() < 0.5:
            value = random.choice((np.nan, np.inf, -np.inf, 1e308, 1e-320, -0.0))
        with np.errstate(all="ignore"):
            flat[at] = np.array(float(value)).astype(array.dtype)
        arrays[name] = flat.reshape(array.shape)
    elif kind == 4:
        shapes = [array[..., None], array.reshape(-1)]
        shapes += [array[:0], array[:-1]] if array.ndim else []
        arrays[name] = random.choice(shapes)
    elif kind == 5:
        try:
            with np.errstate(all="ignore"):
                arrays[name] = array.astype(random.choice(_TYPES))
        except (TypeError, ValueError, RuntimeError):
            arrays[name] = np.zeros(array.shape, random.choice(_TYPES))
    elif kind == 6:
        arrays[name] = np.concatenate([array, array]) if array.ndim else array
    elif kind == 7:
        del arrays[name]
    else:
        arrays[random.choice((name + "x", "x", name[1:] or "y"))] = arrays.pop(name)
