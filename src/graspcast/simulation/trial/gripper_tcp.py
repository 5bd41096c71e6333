"""Whether the opening and the tool centre point (TCP) that a gripper states are those it has."""

from __future__ import annotations

import numpy as np

from graspcast.io.conformance import UnmetError
from graspcast.simulation.trial.gripper_measurement import GripperMeasurement

__all__ = ["check_aligned", "check_centred", "check_opening"]

_ALIGNED_DEG, _APPROACH_DEG = 30.0, 75.0
_OFF_M, _OFF_SHARE = 0.005, 0.06
"""How far the TCP may be off the middle of the gap, metres and as a share of the opening."""
_BEHIND_M, _BEYOND_M = 0.012, 0.001
"""How far it may be behind where the fingers touch objects, and beyond the fingertips, metres."""
_OPENING_M, _OPENING_SHARE = 0.008, 0.25


def check_opening(measured: GripperMeasurement, stated_m: float) -> str:
    """Compare the opening with the stated one, metres, and say what was found.

    Raises
    ------
    UnmetError
        If they differ by more than a quarter.
    """
    found = measured.opening_m
    if abs(found - stated_m) > max(_OPENING_M, _OPENING_SHARE * stated_m):
        raise UnmetError(
            f"the open fingers are {1e3 * found:.1f} mm apart where they grasp, and max_opening_m "
            f"is {1e3 * stated_m:.1f} mm; state what they have, or open them further"
        )
    return f"the open fingers are {1e3 * found:.1f} mm apart ({1e3 * stated_m:.1f} mm stated)"


def check_aligned(measured: GripperMeasurement) -> str:
    """Compare closing direction and approach with x and z of the TCP, and say what was found.

    Raises
    ------
    UnmetError
        If one of them is another direction.
    """
    angle, away = measured.closing_angle_deg, measured.approach_angle_deg
    along = np.abs(measured.closing) > np.cos(np.radians(_ALIGNED_DEG))
    if not measured.all_sides and along[2]:
        raise UnmetError(
            "from open to closed the fingers move along z of the TCP, not along x; z is the "
            "direction out along the fingers, x that in which they close: turn the TCP's frame"
        )
    if not measured.all_sides and angle > _ALIGNED_DEG:
        axis = "along y" if along[1] else f"at {angle:.0f}° to x"
        raise UnmetError(
            f"from open to closed the fingers move {axis} of the TCP, not along x: reference "
            f"grasps would be tried turned by {angle:.0f}°; turn the TCP's frame about its z"
        )
    if away > _APPROACH_DEG:
        raise UnmetError(
            f"z of the TCP is {away:.0f}° off the direction from the palm out between the fingers; "
            "z is the direction of approach: turn the TCP's frame"
        )
    if measured.all_sides:
        return f"the fingers close from all sides to an axis {away:.0f}° off z of the TCP"
    return f"the fingers close along x of the TCP ({angle:.0f}° off)"


def check_centred(measured: GripperMeasurement) -> str:
    """Check that the TCP is between the fingers, and say how far it is off the middle of the gap.

    Raises
    ------
    UnmetError
        If it is too far off the middle, behind the fingers' pads, or beyond their tips.
    """
    x, y = measured.gap_m[:2]
    off, most = float(np.hypot(x, y)), max(_OFF_M, _OFF_SHARE * measured.opening_m)
    low, high = measured.touch_m
    if off > most:
        problem = (
            f"the middle of the gap between the fingers is {1e3 * off:.1f} mm off the TCP "
            f"(x {1e3 * x:+.1f}, y {1e3 * y:+.1f} mm; at most {1e3 * most:.1f} mm)"
        )
    elif not low - _BEHIND_M <= 0 <= measured.tip_m + _BEYOND_M:
        problem = (
            f"the fingers touch objects from {1e3 * low:+.1f} to {1e3 * high:+.1f} mm along z of "
            f"the TCP, and end at {1e3 * measured.tip_m:+.1f} mm"
        )
    else:
        return f"the middle of the gap is {1e3 * off:.1f} mm off the TCP"
    base = ", ".join(f"{v:.4f}" for v in measured.base_T_tcp[:3, 3])
    raise UnmetError(f"{problem}: move the TCP; the gap's centre is at {base} m of the base")
