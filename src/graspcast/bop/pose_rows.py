"""Rows of poses in a file, before they are checked, and what a file does not say itself."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import Any

from graspcast.errors import FormatError

__all__ = ["PoseRows", "Stated"]

_NUMBERED = re.compile(r"(?:.*[^a-z])?obj_0*(\d+)", re.IGNORECASE)
_PLACEHOLDERS = (-1, 0)


@dataclass(frozen=True)
class Stated:
    """What is stated about a file of poses, because the file itself may not say it.

    Attributes
    ----------
    scene_id, im_id
        The scene and the image, where there is one; None for those of the file.
    objects
        Object's name in the file to its number; the name ``""`` stands for the only object.
    unit
        The unit of translations; None for that of the format.
    """

    scene_id: int | None = None
    im_id: int | None = None
    objects: Mapping[str, int] = field(default_factory=dict)
    unit: str | None = None

    def number(
        self, what: str, given: int | None, path: str | PathLike[str], where: str | None
    ) -> int:
        """Return the scene or the image that is stated, or else that the file gives.

        Parameters
        ----------
        what
            ``scene_id`` or ``im_id``.
        given
            What the file says, None if it says nothing.
        path, where
            The file and the place in it, for messages.

        Raises
        ------
        FormatError
            If neither says it, or they contradict each other; -1 and 0 in a file say nothing.
        """
        stated = self.scene_id if what == "scene_id" else self.im_id
        noun = {"scene_id": "scene", "im_id": "image"}[what]
        if stated is None and given is None:
            raise FormatError(
                path,
                f"does not say which {noun} it is of; state it",
                where=where,
                parameters=(what,),
            )
        if stated is not None and given not in (None, stated, *_PLACEHOLDERS):
            raise FormatError(
                path, f"is of {noun} {given}, not of {stated}", where=where, parameters=(what,)
            )
        return stated if stated is not None else int(given or 0)

    def object_number(
        self, name: str, names: Sequence[str], path: str | PathLike[str], where: str | None
    ) -> int:
        """Return the number of an object that a file names.

        Parameters
        ----------
        name, names
            The name, and all names in the file. ``obj_000005``, with anything before it, is 5, as
            is ``5``; other names have to be stated.
        path, where
            The file and the place in it, for messages.

        Raises
        ------
        FormatError
            If the number is not known.
        """
        if name in self.objects:
            return self.objects[name]
        if "" in self.objects and len(set(names)) == 1:
            return self.objects[""]
        match = _NUMBERED.fullmatch(name)
        digits = match[1] if match else name
        if digits.isascii() and digits.isdecimal() and len(digits) < 10:
            return int(digits)
        listed = ", ".join(map(repr, sorted(set(names) - {""})[:10]))
        raise FormatError(
            path,
            f"which object is {name!r}? State its number; the file has {listed}"
            if name
            else "does not say which object it is of; state its number",
            where=where,
            parameters=("object_numbers",),
        )


@dataclass(frozen=True)
class PoseRows:
    """Rows of poses as a file has them.

    Attributes
    ----------
    rows
        The cells of :data:`graspcast.bop.results_rows.COLUMNS`; None for a row that has others.
    places
        The place of each row in the file, from 1 for lines and from 0 for entries.
    place
        What these count: ``"line"``, ``"entry"``, ``"file"``.
    unit
        The unit of t.
    remarks
        What the reader had to do without, in words.
    """

    rows: Sequence[Sequence[Any] | None]
    places: Sequence[int]
    place: str
    unit: str
    remarks: tuple[str, ...] = ()
