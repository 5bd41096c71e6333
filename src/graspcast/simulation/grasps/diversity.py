"""Diversity of grasps: how far apart they are, where symmetric equivalents are the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import ModelInfo
from graspcast.pose.transforms import invert
from graspcast.simulation.grasps.proposals import OpenHand
from graspcast.simulation.objects.surface import Surface
from graspcast.simulation.objects.symmetries import find_symmetries
from graspcast.simulation.objects.types import GraspObject

__all__ = ["Spacing", "hand_symmetries", "shape_symmetries"]

_SAME_M = 2e-3
_MOST_SYMMETRIES = 72


@dataclass(frozen=True, eq=False)
class Spacing:
    """Smallest distance between two grasps that count as different.

    They are different if, in the frame of one of them, the other is at least ``apart_m`` away or
    turned by at least ``apart_rad``, whichever equivalents of both are compared.

    Attributes
    ----------
    apart_m, apart_rad
        Distance of the tool centre points, metres, and angle between the frames.
    of_object
        Symmetries of the object, with the identity, (s, 4, 4); long lists are thinned out.
    of_hand
        Turns about the hand's z axis after which it is the same, with the identity, (h, 4, 4).
    """

    apart_m: float
    apart_rad: float
    of_object: Float[ndarray, "s 4 4"]
    of_hand: Float[ndarray, "h 4 4"]

    def spread(self, grasps: Float[ndarray, "n 4 4"], count: int, *, kept: int = 0) -> list[int]:
        """Choose up to ``count`` grasps that are all different, earlier ones first.

        Parameters
        ----------
        grasps
            Grasps of one object by one hand, the best first.
        count
            Largest number of grasps.
        kept
            Number of grasps at the start that are kept however near they are.

        Returns
        -------
            Their row numbers, ascending.
        """
        chosen: list[int] = []
        free = np.ones(len(grasps), dtype=bool)
        for row in range(len(grasps)):
            if len(chosen) == count:
                break
            if free[row] or row < kept:
                chosen.append(row)
                free &= self.apart(grasps[row], grasps) >= 1.0
        return chosen

    def apart(
        self, grasp: Float[ndarray, "4 4"], others: Float[ndarray, "n 4 4"]
    ) -> Float[ndarray, " n"]:
        """Return how far others are from a grasp, 1 where they begin to be different."""
        step = -(-len(self.of_object) // _MOST_SYMMETRIES)
        same = self.of_object[::step, None] @ grasp @ self.of_hand[None]
        steps = invert(same.reshape(-1, 4, 4))[:, None] @ others[None]
        shift = np.linalg.norm(steps[..., :3, 3], axis=2) / self.apart_m
        cosine = (np.trace(steps[..., :3, :3], axis1=2, axis2=3) - 1) / 2
        turn = np.arccos(np.clip(cosine, -1.0, 1.0)) / self.apart_rad
        nearest: ndarray = np.maximum(shift, turn).min(axis=0)
        return nearest


def hand_symmetries(hand: OpenHand) -> Float[ndarray, "h 4 4"]:
    """Return the turns about the hand's z axis after which its boxes lie where others did.

    The identity is the first. Tried are half, third, quarter, sixth and eighth turns.
    """
    middles, half = hand.tcp_T_box[:, :3, 3], hand.half
    size = np.abs(hand.tcp_T_box[:, :3, :3]) @ half[:, :, None]
    found = [np.eye(4)]
    for fold in (8, 6, 4, 3, 2):
        turns = [_about_z(2 * np.pi * k / fold) for k in range(1, fold)]
        if all(_same(turn, middles, size[..., 0], hand) for turn in turns):
            return np.array([*found, *turns])
    return np.array(found)


def shape_symmetries(grasp_object: GraspObject) -> tuple[Float[ndarray, "s 4 4"], str]:
    """Return the symmetries of an object's shape, with the identity, and say them in words."""
    found = find_symmetries(Surface(grasp_object.vertices, grasp_object.faces))
    info = ModelInfo(0, 1.0, np.zeros(3), np.ones(3), found.discrete, found.continuous)
    return info.symmetries, str(found)


def _about_z(angle: float) -> Float[ndarray, "4 4"]:
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return turn


def _same(
    turn: Float[ndarray, "4 4"],
    middles: Float[ndarray, "g 3"],
    size: Float[ndarray, "g 3"],
    hand: OpenHand,
) -> bool:
    turned = turn[:3, :3] @ hand.tcp_T_box[:, :3, :3]
    moved = middles @ turn[:3, :3].T
    extent = np.abs(turned) @ hand.half[:, :, None]
    off = np.abs(moved[:, None] - middles[None]).max(axis=2)
    grown = np.abs(extent[:, None, :, 0] - size[None]).max(axis=2)
    return bool((np.maximum(off, grown).min(axis=1) <= _SAME_M).all())
