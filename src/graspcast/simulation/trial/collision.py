"""Collision on the approach: what the hand presses against, and when the arm stops.

An arm stops by itself when an outside force on its hand lasts. That force is the sum of all contact
forces on the hand, which a force sensor in the wrist, or the torques of the joints, would show; two
fingers that an object spreads apart add nothing to it.
"""

from __future__ import annotations

from collections import deque
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.simulation.engine import mujoco
from graspcast.simulation.trial.scene import HAND, OBJECT, TABLE, Scene

__all__ = ["SAMPLE_S", "Approach", "CollisionMonitor", "forces_on_hand"]

SAMPLE_S = 0.01
"""Time between two samples of the force, seconds."""

Body = Literal["object", "table"]
_WITH_HAND: dict[int, Body] = {HAND + OBJECT: "object", HAND + TABLE: "table"}


class Approach(NamedTuple):
    """What happened on an approach: the fields of an outcome of the same names.

    Attributes
    ----------
    short_m
        How far short of its goal the hand is, metres.
    force_n
        Largest net force on the hand that lasted for ``contact_s``, newtons.
    hit
        What exerted the larger part of it; None without contact.
    """

    short_m: float = 0.0
    force_n: float = 0.0
    hit: Body | None = None


class _Sample(NamedTuple):
    time_s: float
    force_n: float
    hit: Body | None


def forces_on_hand(scene: Scene) -> dict[Body, Float[ndarray, " 3"]]:
    """Return the net contact forces on the hand in the current state, by what exerts them.

    Returns
    -------
        Newtons, in the world's frame; only of what touches the hand.
    """
    net: dict[Body, ndarray] = {}
    contact = scene.data.contact
    if not scene.data.ncon:
        return net
    kinds = scene.kind[contact.geom]
    force = np.zeros(6)
    # Object, hand and table have one kind each, so a pair is known by its sum.
    for i, pair in enumerate(kinds.sum(axis=1).tolist()):
        if pair not in _WITH_HAND:
            continue
        mujoco.mj_contactForce(scene.model, scene.data, i, force)
        # MuJoCo gives the force on the second geom, along the rows of the contact's frame.
        sign = 1.0 if kinds[i, 1] == HAND else -1.0
        body = _WITH_HAND[pair]
        net[body] = net.get(body, 0.0) + sign * (force[:3] @ contact.frame[i].reshape(3, 3))
    return net


class CollisionMonitor:
    """Watches the force on the hand during the approach, and decides when the arm stops.

    Parameters
    ----------
    scene
        The scene of the trial; its settings have the limits.
    """

    def __init__(self, scene: Scene):
        self._scene = scene
        self._window: deque[_Sample] = deque()
        self._largest = _Sample(0.0, 0.0, None)
        self._stopped = False

    def should_stop(self, time_s: float) -> bool:
        """Record the force on the hand, and return whether the arm stops because of it.

        Call it at regular times, ``time_s`` seconds since the start of the approach. The arm stops
        if the force has been above the limit for ``contact_s``.
        """
        scene, settings = self._scene, self._scene.settings
        sample = _Sample(time_s, 0.0, None)
        if forces := forces_on_hand(scene):
            hit = max(forces, key=lambda body: float(np.linalg.norm(forces[body])))
            sample = _Sample(time_s, float(np.linalg.norm(sum(forces.values()))), hit)
        self._window.append(sample)
        since = time_s - settings.contact_s + 1e-9
        while len(self._window) > 1 and self._window[1].time_s <= since:
            self._window.popleft()
        if self._window[0].time_s <= since:
            lasting = min(sample.force_n for sample in self._window)
            if lasting > self._largest.force_n:
                self._largest = self._window[-1]._replace(force_n=lasting)
            limit = settings.contact_force_n
            self._stopped = limit is not None and lasting > limit
        return self._stopped

    def result(self) -> Approach:
        """Return what has happened so far."""
        short = max(0.0, -float(self._scene.data.qpos[self._scene.approach_qpos]))
        return Approach(short, self._largest.force_n, self._largest.hit)

    def collided(self) -> bool:
        """Return whether the arm has stopped because of a force, or is short of its goal."""
        limit = self._scene.settings.short_m
        return self._stopped or (limit is not None and self.result().short_m > limit)
