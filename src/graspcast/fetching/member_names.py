"""Names of an archive's members: those that leave the folder or collide are refused."""

from __future__ import annotations

import re
import unicodedata

__all__ = ["Names", "UnsafeNameError", "parts_of"]

_RESERVED = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³])", re.IGNORECASE)
_FORBIDDEN = re.compile(r'[<>:"|?*\\\x00-\x1f\x7f]')
_LONGEST, _DEEPEST = 200, 32


class UnsafeNameError(Exception):
    """A member's name is not safe; the text says why."""


def parts_of(name: str) -> tuple[str, ...]:
    """Split a member's name at its slashes.

    Raises
    ------
    UnsafeNameError
        If it is absolute, has ``..``, or is no name on Linux, macOS and Windows alike.
    """
    if name.startswith("/"):
        raise UnsafeNameError("is an absolute path")
    parts = tuple(part for part in name.split("/") if part not in ("", "."))
    if not parts:
        raise UnsafeNameError("is no name")
    if len(parts) > _DEEPEST:
        raise UnsafeNameError("lies too deep")
    for part in parts:
        if part == "..":
            raise UnsafeNameError("leads out of the folder")
        try:
            length = len(part.encode())
        except UnicodeEncodeError:
            raise UnsafeNameError("is not valid Unicode") from None
        if length > _LONGEST:
            raise UnsafeNameError("is too long")
        if found := _FORBIDDEN.search(part):
            raise UnsafeNameError(f"has the character {found[0]!r}, which some systems forbid")
        if part[-1] in ". " or part[0] == " ":
            raise UnsafeNameError("begins or ends with a space, or ends with a dot")
        if _RESERVED.fullmatch(part.partition(".")[0].rstrip()):
            raise UnsafeNameError("is the name of a device on Windows")
    return parts


class Names:
    """The names so far, which no further one may collide with, whatever the system."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[str, bool]] = {}
        self._files: set[str] = set()

    def add(self, parts: tuple[str, ...], *, folder: bool) -> None:
        """Add a name and its folders.

        Raises
        ------
        UnsafeNameError
            If a file is named twice, is a folder too, or differs from another name only in case or
            in how its letters are encoded.
        """
        for depth in range(1, len(parts) + 1):
            path = "/".join(parts[:depth])
            is_folder = folder or depth < len(parts)
            key = unicodedata.normalize("NFC", unicodedata.normalize("NFC", path).casefold())
            known = self._known.setdefault(key, (path, is_folder))
            if known[0] != path:
                raise UnsafeNameError(f"is the same as {known[0]!r} on some systems")
            if known[1] != is_folder:
                raise UnsafeNameError("is both a file and a folder")
        if parts and not folder:
            path = "/".join(parts)
            if path in self._files:
                raise UnsafeNameError("is there twice")
            self._files.add(path)
