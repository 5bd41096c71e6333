"""Short descriptions of tables of instances, for ``repr``."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy import ndarray

from graspcast.io.wording import counted

__all__ = ["summary"]


@runtime_checkable
class _Table(Protocol):
    @property
    def scene_id(self) -> ndarray: ...
    @property
    def im_id(self) -> ndarray: ...
    @property
    def obj_id(self) -> ndarray: ...
    @property
    def source(self) -> str: ...


def summary(table: _Table, noun: str) -> str:
    """Describe a table of instances: how many there are of how many objects and images, and whence.

    For example ``"1445 poses of 8 objects in 200 images, epos_lmo-test.csv"``.
    """
    images = np.unique(np.stack([table.scene_id, table.im_id]), axis=1).shape[1]
    objects = len(np.unique(table.obj_id))
    return (
        f"{counted(len(table.obj_id), noun)} of {counted(objects, 'object')} in "
        f"{counted(images, 'image')}, {Path(table.source).name}"
    )
