"""Bench on which grippers are tried: a standing column, a grasp of it, and a hand in the air."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.simulation.engine import mujoco
from graspcast.simulation.grippers.protocol import Closing, Gripper
from graspcast.simulation.objects.types import Grasp, GraspObject, Primitive, box_corners
from graspcast.simulation.trial.scene import Scene

__all__ = ["ParkedHand", "grasp_of_column", "standing_column"]

_SNAPSHOTS, _READINGS = 24, 10
_REST_S = 0.5


def grasp_of_column(gripper: Gripper, width_m: float, raised_m: float = 0.0) -> Grasp:
    """Return the grasp of a column from above, the TCP half a width below its top.

    Parameters
    ----------
    gripper
        The gripper.
    width_m
        The column's width, metres.
    raised_m
        How much higher the TCP is, metres.
    """
    obj_T_grasp = np.diag([1.0, -1.0, -1.0, 1.0])
    obj_T_grasp[2, 3] = width_m + raised_m
    return Grasp(obj_T_grasp, "test column", gripper.name)


def standing_column(
    width_m: float, *, depth_m: float | None = None, mass_kg: float = 0.3, friction: float = 0.8
) -> GraspObject:
    """Return a column that stands on the table, three times as high as wide.

    Its origin is its centre.

    Parameters
    ----------
    width_m
        Side along x, metres.
    depth_m
        Side along y, metres; by default the same.
    mass_kg
        Mass.
    friction
        Coefficient of friction.
    """
    size = np.array([width_m, depth_m or width_m, 3 * width_m])
    standing = np.eye(4)
    standing[2, 3] = size[2] / 2
    return GraspObject(
        name="test column",
        vertices=box_corners(size / 2),
        faces=np.zeros((0, 3), dtype=np.int64),
        pieces=(Primitive("box", (size[0] / 2, size[1] / 2, size[2] / 2), np.eye(4)),),
        mass_kg=mass_kg,
        friction=friction,
        centroid=np.zeros(3),
        inertia=np.diag(mass_kg / 12 * (np.sum(size**2) - size**2)),
        sim_T_ref=standing,
    )


class ParkedHand:
    """Hand of a scene at rest, high above object and table, or at a pose of its base.

    Parameters
    ----------
    scene
        The scene.
    sim_T_base
        The pose; by default high above.
    """

    def __init__(self, scene: Scene, sim_T_base: Float[ndarray, "4 4"] | None = None):
        self.scene = scene
        if sim_T_base is None:
            scene.park()
        else:
            scene.place(sim_T_base, 0.0)

    def command(self, controls: Mapping[str, float], seconds: float) -> None:
        """Set the actuators' controls, and simulate some time."""
        scene = self.scene
        for name, value in controls.items():
            scene.data.ctrl[scene.hand_ctrl[name]] = value
        mujoco.mj_step(scene.model, scene.data, nstep=round(seconds / scene.settings.timestep))

    def ramp(self, start: Mapping[str, float], end: Mapping[str, float], seconds: float) -> None:
        """Move the controls linearly from one command to another."""
        count = max(1, round(seconds / 0.01))
        for k in range(1, count + 1):
            self.command({n: start[n] + k / count * (end[n] - start[n]) for n in start}, 0.01)

    def close(self, closing: Closing, rest_s: float) -> list[ndarray]:
        """Close the open hand on nothing, and return ``data.qpos`` from open to closed."""
        postures = [self.scene.data.qpos.copy()]
        spot = dict(closing.open)
        for k in range(1, _SNAPSHOTS + 1):
            part = k / _SNAPSHOTS
            step = {n: a + part * (closing.close[n] - a) for n, a in closing.open.items()}
            self.ramp(spot, step, closing.seconds / _SNAPSHOTS)
            postures.append(self.scene.data.qpos.copy())
            spot = step
        self.command(closing.close, rest_s)
        return [*postures, self.scene.data.qpos.copy()]

    def grip_n(self, closing: Closing) -> float:
        """Close the open hand, and return the force on each side of what is in it, newtons."""
        self.command(closing.open, 0.1)
        self.ramp(closing.open, closing.close, closing.seconds)
        self.command(closing.close, _REST_S)
        forces = []
        for _ in range(_READINGS):
            self.command(closing.close, 0.02)
            forces.append(self.scene.grip_n())
        return float(np.mean(forces))
