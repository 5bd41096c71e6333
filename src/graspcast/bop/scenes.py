"""Scene folders of a split: which there are, and the annotation files in them, of one camera.

With one camera a scene folder holds ``scene_gt.json``, ``scene_camera.json`` and the images in
``rgb`` or ``gray``. With several, as in BOP-Industrial, every name ends in the camera's:
``scene_gt_cam1.json``, ``rgb_cam1``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from graspcast.errors import InputError, UnknownNameError

__all__ = ["Scenes", "find_split", "sensors_in"]

_ANNOTATIONS = re.compile(r"scene_(?:gt|camera)(?:_(?!info|coco)(\w+?))?\.json")


def sensors_in(directory: Path) -> list[str]:
    """Return the cameras' names in the annotation files of scene folders; ``""`` for none."""
    found = {
        match[1] or ""
        for path in directory.glob("*/scene_*.json")
        if path.parent.name.isdecimal() and (match := _ANNOTATIONS.fullmatch(path.name))
    }
    return sorted(found)


@dataclass(frozen=True)
class Scenes:
    """The scene folders of one split.

    Attributes
    ----------
    directory
        The split, which holds the scene folders.
    sensor
        The camera's name at the end of every file, empty if there is one camera without a name.
    """

    directory: Path
    sensor: str = ""

    @classmethod
    def find(cls, directory: Path, sensor: str | None = None) -> Scenes:
        """Find the camera whose annotations a split holds.

        Parameters
        ----------
        directory
            The split.
        sensor
            The camera's name; by default the only one.

        Raises
        ------
        UnknownNameError
            If there is no such camera.
        InputError
            If there are several, and none is named.
        """
        found = sensors_in(directory)
        if sensor is not None and found and found != [""]:
            if sensor not in found:
                known = [name for name in found if name]
                raise UnknownNameError("camera", sensor, known, parameters=("sensor",))
            return cls(directory, sensor)
        if "" in found or not found:
            return cls(directory)
        if len(found) > 1:
            raise InputError(
                f"{directory}: has annotations of several cameras, {', '.join(found)}; name one",
                parameters=("sensor",),
            )
        return cls(directory, found[0])

    def file(self, kind: str) -> str:
        """Return the name of the annotation file of a kind: ``gt``, ``gt_info``, ``camera``."""
        return f"scene_{kind}{f'_{self.sensor}' if self.sensor else ''}.json"

    def has(self, kind: str) -> bool:
        """Return whether a scene folder has annotations of a kind."""
        return any(self.directory.glob(f"*/{self.file(kind)}"))

    @property
    def image_folders(self) -> tuple[str, ...]:
        """Names of the folder with the images, of which a scene folder has one: RGB first."""
        if not self.sensor:
            return "rgb", "gray"
        return f"rgb_{self.sensor}", f"gray_{self.sensor}", self.sensor

    def annotations(self, kind: str) -> Iterator[tuple[int, Path]]:
        """Yield scene id and path of the annotation file in each scene folder that has it.

        Raises
        ------
        InputError
            If there is no such directory, no folder has the file, or two are the same scene.
        """
        directory, file = self.directory, self.file(kind)
        if not directory.is_dir():
            others = [p for p in sorted(directory.parent.glob("*")) if any(p.glob(f"*/{file}"))]
            there = ", ".join(map(str, others))
            raise InputError(
                f"{directory}: no such directory; it should hold scene folders (000001 …)"
                + (f"; there is {there}; give that if it is meant" if others else ""),
                parameters=("ground_truth", "split"),
            )
        found = sorted(p for p in directory.iterdir() if p.name.isdecimal() and (p / file).exists())
        numbers_of = [int(folder.name) for folder in found]
        for folder, number in zip(found, numbers_of, strict=True):
            if numbers_of.count(number) > 1:
                raise InputError(f"{folder}: another folder here is scene {number} too; keep one")
        if not found:
            raise InputError(
                f"{directory}: no scene folder here has a {file}", parameters=("ground_truth",)
            )
        for folder in found:
            yield int(folder.name), folder / file


def find_split(root: Path, split: str | None = None) -> Path:
    """Return the directory of a split.

    Parameters
    ----------
    root
        The dataset's directory.
    split
        Its name, with or without a type, as in a directory or in the name of a results file:
        ``test_primesense``, ``test-primesense``. By default ``test``, or, where there is none, the
        only one that begins so.

    Raises
    ------
    InputError
        If there are several that begin so, and none is named.
    """
    if split is not None:
        usual = root / split.replace("-", "_")
        return usual if usual.is_dir() and not (root / split).is_dir() else root / split
    if (root / "test").is_dir():
        return root / "test"
    typed = [path for path in sorted(root.glob("test_*")) if path.is_dir()]
    if len(typed) > 1:
        raise InputError(
            f"{root}: has several splits, {', '.join(p.name for p in typed)}; name one",
            parameters=("split", "ground_truth"),
        )
    return typed[0] if typed else root / "test"
