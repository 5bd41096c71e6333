"""Units of length: whether a length fits what is known independently, and which unit would fit.

Files rarely state their unit, and a wrong one is a factor of 10, 25.4 or 1000. So every length from
outside is compared with a :class:`Reference`: the distance of an object with its diameter, a
diameter with the extent of the mesh, an object with what a hand can grasp. :func:`unit_problem`
words a contradiction everywhere alike, with both numbers and the unit that would fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, log, sqrt

__all__ = ["METRES", "UNIT_NAMES", "Reference", "between", "fitting_units", "shown", "unit_problem"]

METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254}
"""Metres per unit."""

UNIT_NAMES = {"mm": "millimetres", "cm": "centimetres", "m": "metres", "inch": "inches"}
"""The units in words."""

_MISREADINGS = (("mm", "m"), ("cm", "m"), ("inch", "m"), ("m", "mm"), ("cm", "mm"), ("inch", "mm"))
"""The unit meant and the unit read, the likeliest first."""


@dataclass(frozen=True)
class Reference:
    """What a length is compared with.

    Attributes
    ----------
    says
        What is known, with its number, as a clause: ``"the mesh is 102 mm across"``.
    low_m, high_m
        Between which the length contradicts nothing, metres.
    usual_m
        Between which it lies nearly always, metres; a unit in which it does is suggested. By
        default the same.
    """

    says: str
    low_m: float
    high_m: float
    usual_m: tuple[float, float] | None = None

    def fits(self, length_m: float) -> bool:
        """Return whether a length contradicts nothing; NaN, which is unknown, does not."""
        return not (length_m < self.low_m or length_m > self.high_m)


def fitting_units(
    length_m: float, reference: Reference, *, unit: str | None = None
) -> list[tuple[str, str, float]]:
    """Find the units in which a length that was read in another unit is usual.

    Parameters
    ----------
    length_m
        The length as it was read, metres.
    reference
        What it is compared with.
    unit
        The unit in which it was read; by default unknown, either millimetres or metres.

    Returns
    -------
        Unit meant, unit read, and the length in metres if it is so; the nearest to the middle of
        the usual range first. One at most if ``unit`` is unknown.
    """
    low, high = reference.usual_m or (reference.low_m, reference.high_m)
    pairs = [(u, unit) for u in METRES if u != unit] if unit else _MISREADINGS
    found = [
        (meant, read, length_m * METRES[meant] / METRES[read])
        for meant, read in pairs
        if low <= length_m * METRES[meant] / METRES[read] <= high
    ]
    if unit is None:
        return found[:1]
    middle = sqrt(low * high)
    return sorted(found, key=lambda f: abs(log(f[2] / middle)))


def unit_problem(
    what: str, length_m: float, reference: Reference, *, unit: str | None = None
) -> str:
    """Say how a length contradicts what is known independently, with both numbers.

    Parameters
    ----------
    what
        The length in words: ``"the median distance"``.
    length_m, reference, unit
        As for :func:`fitting_units`.

    Returns
    -------
        The problem and the unit that would fit; an empty text for a length that fits.

    Examples
    --------
    >>> across = Reference("the mesh is 102 mm across", 0.100, 0.104)
    >>> unit_problem("the diameter", 0.000102, across, unit="mm")
    'the diameter is 0.102 mm, but the mesh is 102 mm across; is it in metres (102 mm), not in millimetres?'
    >>> unit_problem("the diameter", 0.102, across, unit="mm")
    ''
    """  # noqa: E501
    if reference.fits(length_m):
        return ""
    said = f"{what} is {shown(length_m)}, but {reference.says}"
    found = fitting_units(length_m, reference, unit=unit)
    if not found:
        return said
    meant = " or ".join(f"in {UNIT_NAMES[m]} ({shown(as_m)})" for m, _, as_m in found)
    return f"{said}; is it {meant}, not in {UNIT_NAMES[found[0][1]]}?"


def shown(length_m: float) -> str:
    """Format a length: ``"102 mm"``, and from half a metre ``"0.82 m"``."""
    if not isfinite(length_m):
        return "unknown"
    if abs(length_m) < 0.5:
        return f"{1000 * length_m:.3g} mm"
    if abs(length_m) >= 1e5:
        return f"{length_m:.3g} m"
    return f"{length_m:.{2 if abs(length_m) < 10 else 0}f} m"


def between(low_m: float, high_m: float) -> str:
    """Format a range of lengths: ``"102 to 123 mm"``, ``"98 mm to 1.20 m"``."""
    low, high = shown(low_m), shown(high_m)
    if low == high:
        return low
    number, _, unit = low.partition(" ")
    return f"{number} to {high}" if high.endswith(f" {unit}") else f"{low} to {high}"
