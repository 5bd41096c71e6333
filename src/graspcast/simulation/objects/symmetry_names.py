"""Symmetries that a user states by name, held against the shape."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.pose.lengths import shown
from graspcast.pose.transforms import rotation_from_vector
from graspcast.simulation.objects.rotation_groups import closed_group
from graspcast.simulation.objects.surface import Surface
from graspcast.simulation.objects.symmetries import Symmetries, deviation, symmetries_about

__all__ = ["check_symmetry_names", "stated_symmetries"]

_NAME = re.compile(r"([xyz])([0-9]*)")
_MOST_FOLD = 36


def check_symmetry_names(names: Sequence[str]) -> None:
    """Check that names are ``auto`` or ``none`` alone, or axes with their folds: ``z``, ``x2``.

    Raises
    ------
    InputError
        Naming the first that is none of these.
    """
    for name in names:
        found = _NAME.fullmatch(name)
        folds = found is not None and (not found[2] or 2 <= int(found[2]) <= _MOST_FOLD)
        if not folds and not (name in ("auto", "none") and len(names) == 1):
            raise InputError(
                f"the symmetry {name!r} should be auto or none alone, an axis for any angle about "
                f"it (x, y, z), or an axis and a number of folds from 2 to {_MOST_FOLD} (z2, x4)",
                parameters=("symmetry",),
            )


def stated_symmetries(surface: Surface, names: Sequence[str]) -> tuple[Symmetries, str]:
    """Return the symmetries that names state, about the middle of the shape, and a doubt.

    Parameters
    ----------
    surface
        The shape.
    names
        ``("none",)``, or axes and folds: ``("z", "x2")`` for a cylinder.

    Returns
    -------
        The symmetries, and how far the shape contradicts them; empty if it does not.
    """
    check_symmetry_names(names)
    if tuple(names) == ("none",):
        return symmetries_about(surface, np.empty((0, 3))), ""
    axes, turns = [], []
    for name in names:
        axis = np.eye(3)["xyz".index(name[0])]
        if name[1:]:
            turns.append(rotation_from_vector(axis * (2 * np.pi / int(name[1:]))))
        else:
            axes.append(axis)
    group = closed_group(turns, np.deg2rad(2.0))
    if group is None or (len(axes) == 1 and not all(_keeps(axes[0], R) for R in turns)):
        raise InputError(
            f"the symmetries {', '.join(names)} together are more than a finite group, or an axis "
            "and a half turn across it; a ball is x y z",
            parameters=("symmetry",),
        )
    discrete = group[1:]
    if axes:
        # Turns about the axis are among its own; of those across it, one gives the others.
        across = [R for R in turns if axes[0] @ R @ axes[0] < 0]
        discrete = np.array(across[:1] if len(axes) == 1 else []).reshape(-1, 3, 3)
    found = symmetries_about(surface, np.array(axes).reshape(-1, 3), discrete)
    return found, _doubt(surface, axes, list(group[1:]))


def _keeps(axis: ndarray, rotation: ndarray) -> bool:
    """Return whether a rotation maps an axis to itself or to its opposite."""
    return bool(abs(axis @ rotation @ axis) > 1 - 1e-9)


def _doubt(surface: Surface, axes: Sequence[ndarray], turns: Sequence[ndarray]) -> str:
    tried = [*turns, *(rotation_from_vector(axis * angle) for axis in axes for angle in (0.9, 2.2))]
    found = [deviation(surface, R) for R in tried]
    worst = max(found, key=lambda d: d.nearly_m / d.across_m)
    if worst.small:
        return ""
    return (
        f"the shape does not have the stated symmetry: it moves 1 % of the surface by "
        f"{shown(worst.nearly_m)} or more"
    )
