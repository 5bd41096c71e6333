"""Verdicts on overlays: which instance each is on, who guides, and from where to look again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.bop.results import Results
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import InstanceKey
from graspcast.forecasting.verdict import VerdictRow
from graspcast.forecasting.view_verdicts import FUSED
from graspcast.rendering.drawing import LOOK, PAPER
from graspcast.views.next_look import NextLook

__all__ = ["VerdictTable", "draw_arrow", "side_of", "with_several_views"]

_SAME_POSE = 1e-6
_FAR = 0.25
"""Share of its distance by which a pose that is attempted never differs from its image's own."""
_SIDES = (
    "right", "above right", "above", "above left", "left", "below left", "below", "below right",
)  # fmt: skip
_FINER = 4


def with_several_views(row: VerdictRow) -> bool:
    """Return whether a verdict is from several views, or asks for a further one."""
    return row.views > 1 or row.principal == FUSED or row.verdict.look is not None


class VerdictTable:
    """Verdicts, found by the estimates that they are on.

    Parameters
    ----------
    verdicts
        On instances of one dataset.
    results
        Estimator's name to the estimates that are drawn.

    Raises
    ------
    MismatchError
        If no verdict has one of the estimators as its principal, nor the fused pose.
    """

    def __init__(self, verdicts: Sequence[VerdictRow], results: Mapping[str, Results]):
        self._results = results
        self._mine: dict[tuple[str, InstanceKey], list[VerdictRow]] = {}
        self._others: dict[tuple[str, int, int, int], list[VerdictRow]] = {}
        self._principals = {row.principal for row in verdicts}
        self._several = any(map(with_several_views, verdicts))
        if not self._principals & {*results, FUSED}:
            raise MismatchError(
                f"the verdicts are on estimates by {', '.join(sorted(self._principals))}, but "
                f"the estimates are by {', '.join(results)}",
                parameters=("verdicts", "estimates"),
            )
        for row in verdicts:
            if row.principal in results:
                self._mine.setdefault((row.principal, row.key), []).append(row)
            elif self._several:
                self._others.setdefault(row.key[:4], []).append(row)

    def of_instances(
        self,
        keys: Sequence[Mapping[str, InstanceKey]],
        poses: Sequence[Mapping[str, Float[ndarray, "4 4"]]],
    ) -> list[dict[str, tuple[VerdictRow, ...]]]:
        """Return the verdicts on each instance of an object in an image.

        Those of an estimator are its own, by key. Those by the fused pose, or an estimator that is
        not drawn, are of the nearest instance without another verdict, and stand with its first
        estimate.

        Parameters
        ----------
        keys, poses
            Of each instance, estimator's name to its key and pose.

        Raises
        ------
        InputError
            For an estimate by a principal without a verdict.
        MismatchError
            If a verdict was on another pose.
        """
        out = [
            {name: tuple(self._own(name, key, pose[name])) for name, key in each.items()}
            for each, pose in zip(keys, poses, strict=True)
        ]
        self._add_others(out, keys, poses)
        for each, found in zip(keys, out, strict=True):
            for name, key in each.items():
                missing = name in self._principals and not found[name]
                # The best guide may be another one from instance to instance.
                if missing and not (self._several and any(found.values())):
                    raise InputError(
                        f"no verdict on {key} by {name}: are the verdicts on these estimates?",
                        parameters=("verdicts",),
                    )
        return out

    def _own(
        self, estimator: str, key: InstanceKey, cam_T_est: Float[ndarray, "4 4"]
    ) -> list[VerdictRow]:
        rows = self._mine.get((estimator, key), [])
        if any(np.abs(row.cam_T_obj - cam_T_est).max() > _SAME_POSE for row in rows):
            raise MismatchError(
                f"the verdict on {key} by {estimator} was on another pose than the one in "
                f"{self._results[estimator].source}; give the estimates it is about",
                parameters=("verdicts", "estimates"),
            )
        return rows

    def _add_others(
        self,
        out: list[dict[str, tuple[VerdictRow, ...]]],
        keys: Sequence[Mapping[str, InstanceKey]],
        poses: Sequence[Mapping[str, Float[ndarray, "4 4"]]],
    ) -> None:
        from scipy.optimize import linear_sum_assignment

        first = next(iter(keys[0].values()))
        kinds: dict[tuple[str, str], list[VerdictRow]] = {}
        for row in self._others.get(first[:4], []):
            kinds.setdefault((row.gripper, row.grasp), []).append(row)
        for kind, rows in kinds.items():
            free = [
                i
                for i, found in enumerate(out)
                if all((r.gripper, r.grasp) != kind for some in found.values() for r in some)
            ]
            if not free:
                continue
            gaps = np.array([[_gap(row, poses[i]) for i in free] for row in rows])
            for j, i in zip(*linear_sum_assignment(gaps), strict=True):
                row, name = rows[j], next(iter(keys[free[i]]))
                if row.verdict.attempt and gaps[j, i] > _FAR * np.linalg.norm(row.cam_T_obj[:3, 3]):
                    raise MismatchError(
                        f"the verdict on {row.key} by {row.principal} attempts a pose "
                        f"{1000 * gaps[j, i]:.0f} mm from every estimate of it; give the estimates "
                        "it is about",
                        parameters=("verdicts", "estimates"),
                    )
                out[free[i]][name] += (row,)


def _gap(row: VerdictRow, poses: Mapping[str, Float[ndarray, "4 4"]]) -> float:
    """Return how far a verdict's pose is from the nearest estimate of an instance, metres."""
    at = row.cam_T_obj[:3, 3]
    return min(float(np.linalg.norm(pose[:3, 3] - at)) for pose in poses.values())


def side_of(look: NextLook, cam_T_obj: Float[ndarray, "4 4"]) -> tuple[str, float]:
    """Return to which side the camera goes for a further look, as the image has it.

    Parameters
    ----------
    look
        From where to look.
    cam_T_obj
        The judged pose, metres.

    Returns
    -------
        One of eight words such as "above left"; and the angle in the image, radians,
        counterclockwise from the right.
    """
    now = -cam_T_obj[:3, 3] / np.linalg.norm(cam_T_obj[:3, 3])
    across = look.direction - (look.direction @ now) * now
    angle = float(np.arctan2(-across[1], across[0]))
    return _SIDES[round(angle / (np.pi / 4)) % 8], angle


def draw_arrow(
    pixels: UInt8[ndarray, "size size 3"], angle: float
) -> UInt8[ndarray, "size size 3"]:
    """Draw an arrow near the border of a picture, which points outwards.

    Parameters
    ----------
    pixels
        The picture.
    angle
        Where it points, radians, counterclockwise from the right.
    """
    from PIL import Image, ImageDraw

    size = len(pixels)
    fine = _FINER * size
    picture = Image.fromarray(pixels).resize((fine, fine), Image.Resampling.NEAREST)
    draw = ImageDraw.Draw(picture)
    for colour, more in ((PAPER, 0.008), (LOOK, 0.0)):
        corners = _arrow(more) @ np.array(
            [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        )
        draw.polygon([(float(u), float(v)) for u, v in fine * (0.5 + corners)], fill=colour)
    return np.asarray(picture.resize((size, size), Image.Resampling.BOX))


def _arrow(more: float) -> Float[ndarray, "7 2"]:
    """Return the corners of an arrow to the right, in shares of a picture's side, from its centre.

    ``more`` makes it wider on every side.
    """
    tail, neck, tip, half, head = 0.32, 0.41, 0.48, 0.013, 0.04
    upper = [
        [tail - more, half + more],
        [neck - more, half + more],
        [neck - more, head + 2 * more],
    ]
    lower = [[x, -y] for x, y in reversed(upper)]
    return np.array([*upper, [tip + 2 * more, 0.0], *lower])
