"""One trial: a grasp guided by an estimate, tried in simulation (Sections III-B and IV-C)."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import MismatchError
from graspcast.io.hashing import sha256
from graspcast.pose.transforms import compose, invert
from graspcast.simulation.grippers.protocol import Gripper, gripper_digest
from graspcast.simulation.objects.types import ConvexPiece, Grasp, GraspObject, check_rigid
from graspcast.simulation.trial.early_stopping import Steadiness, beyond_reach, left_behind_m
from graspcast.simulation.trial.scene import Scene, build_scene
from graspcast.simulation.trial.settings import TrialSettings

__all__ = ["REASONS", "Outcome", "Reason", "Record", "TrialRunner", "TrialSettings"]

Reason = Literal["held", "dropped", "slipped", "missed", "blocked", "unstable"]
REASONS: tuple[Reason, ...] = ("held", "dropped", "slipped", "missed", "blocked", "unstable")
Record = Callable[[Any, Any, str], None]
"""Called as ``record(model, data, phase)`` about every 20 ms of a trial, before its first step too.

The phases are "approach", "close" and "lift". The state must not be changed.
"""

_SWEEP_M = 0.002
_COMMAND_S, _CHECK_S, _RECORD_S = 0.02, 0.1, 0.02


@dataclass(frozen=True)
class Outcome:
    """What came of a trial, and why.

    Attributes
    ----------
    success
        Whether the object is still where it was in the hand, within the tolerance.
    reason
        ``held`` is the one success. Failures: ``blocked``, the open hand would start in the object
        or the table; ``missed``, the closed hand did not touch the object with at least two of its
        parts, nor does it touch it at the end; ``dropped``, it did, but at the end it does not
        touch the object; ``slipped``, it touches it at the end, but the object has moved too far;
        ``unstable``, the simulation blew up.
    offset_m
        Distance between the object's centroid in the hand's base frame after closing and after the
        lift. If the trial was stopped early, the distance when it was stopped for an object in the
        hand, and for one left behind the one that the lift would have brought it to. NaN if blocked
        or unstable.
    simulated_s
        Seconds of simulated time.
    computed_s
        Seconds of computing; the one field that differs between equal trials.
    steps
        Simulation steps.
    """

    success: bool
    reason: Reason
    offset_m: float
    simulated_s: float
    computed_s: float
    steps: int


class TrialRunner:
    """Tries grasps of one object with one gripper; the model is compiled once.

    A runner gives bitwise the same outcome for the same input, whatever it ran before. It holds
    one simulation state: give each thread or process its own runner.

    Parameters
    ----------
    grasp_object
        What to grasp.
    gripper
        With what.
    settings
        How.

    Attributes
    ----------
    digest
        SHA-256, as hex, over the object, the gripper and every setting.
    mujoco_version
        Version of the physics engine.
    scene
        The compiled model and its state.

    Raises
    ------
    MismatchError
        If the object does not stay in its reference pose.
    """

    def __init__(
        self,
        grasp_object: GraspObject,
        gripper: Gripper,
        settings: TrialSettings | None = None,
    ):
        self.grasp_object = grasp_object
        self.gripper = gripper
        self.settings = settings or TrialSettings()
        self.mujoco_version: str = mujoco.__version__
        self.scene = build_scene(grasp_object, gripper, self.settings)
        self.digest = _digest(grasp_object, gripper, self.settings)
        self._tcp_T_base = invert(gripper.base_T_tcp)

    def sim_T_base(self, obj_T_est: Float[ndarray, "4 4"], grasp: Grasp) -> Float[ndarray, "4 4"]:
        """Where the hand's base goes: the reference grasp carried over to the estimate."""
        reference = self.grasp_object.sim_T_ref
        return compose(reference, obj_T_est, grasp.obj_T_grasp, self._tcp_T_base)

    def run(
        self,
        obj_T_est: Float[ndarray, "4 4"],
        grasp: Grasp,
        *,
        early_stop: bool = True,
        record: Record | None = None,
    ) -> Outcome:
        """Try the grasp that an estimate would guide.

        Parameters
        ----------
        obj_T_est
            The estimate seen from the true object, ``inv(cam_T_gt) @ cam_T_est``; the identity is a
            perfect estimate.
        grasp
            The reference grasp of this object by this gripper.
        early_stop
            Whether to end as soon as the outcome is certain; the label is that of the full lift.
        record
            Called during the trial, for pictures; the outcome stays the same.

        Raises
        ------
        InputError
            If ``obj_T_est`` is not a finite rigid transform.
        MismatchError
            If the grasp is of another object or gripper.
        """
        check_rigid(obj_T_est, f"the estimate of {self.grasp_object.name!r}")
        for what, mine, given in (
            ("object", self.grasp_object.name, grasp.object),
            ("gripper", self.gripper.name, grasp.gripper),
        ):
            if mine != given:
                raise MismatchError(
                    f"the grasp is for the {what} {given!r}, the trial for {mine!r}"
                )
        trial = _Trial(self.scene, self.gripper, early_stop=early_stop, record=record)
        return trial.run(self.sim_T_base(obj_T_est, grasp))


class _BlowUpError(Exception):
    """The simulation blew up."""


class _Trial:
    """The course of one trial on a scene."""

    def __init__(self, scene: Scene, gripper: Gripper, *, early_stop: bool, record: Record | None):
        self.scene, self.gripper, self.settings = scene, gripper, scene.settings
        self.closing, self.equilibrium = gripper.closing, gripper.equilibrium
        self.model, self.data = scene.model, scene.data
        self.early_stop, self.record = early_stop, record
        self.phase = "approach"
        self.closing_s = 0.0
        self.steps = 0

    def run(self, sim_T_base: Float[ndarray, "4 4"]) -> Outcome:
        started = time.perf_counter()
        try:
            success, reason, offset = self._course(sim_T_base)
        except _BlowUpError:
            success, reason, offset = False, "unstable", math.nan
        return Outcome(
            success=success,
            reason=reason,
            offset_m=offset,
            simulated_s=self.steps * self.settings.timestep,
            computed_s=time.perf_counter() - started,
            steps=self.steps,
        )

    def _course(self, sim_T_base: Float[ndarray, "4 4"]) -> tuple[bool, Reason, float]:
        scene, settings = self.scene, self.settings
        scene.place(sim_T_base, -settings.standoff_m)
        self._show()
        if scene.hand_overlap_m() > settings.overlap_m:
            return False, "blocked", math.nan
        end = sim_T_base[:3, 3]
        start = end - settings.standoff_m * sim_T_base[:3, :3] @ self.gripper.base_T_tcp[:3, 2]
        if self.early_stop and beyond_reach(scene, start, end):
            return False, "missed", settings.lift_height_m
        self._approach()
        self._close()
        return self._lift()

    def _approach(self) -> None:
        """Go to the grasp, open-loop; only from where something could be touched is it physics.

        Until then the object rests and the hand is rigid, so the way there has no consequence.
        """
        scene, data, model = self.scene, self.data, self.model
        for name, value in self.closing.open.items():
            data.ctrl[scene.hand_ctrl[name]] = value
        entry = self._clear_until()
        scene.move_hand(entry)
        if entry == 0.0:
            return
        servo = model.actuator("approach").id
        speed = self.settings.approach_speed
        # In steady motion the servo's set point is ahead by what its damping costs.
        lag = speed * abs(model.actuator_biasprm[servo, 2] / model.actuator_gainprm[servo, 0])
        data.act[model.actuator_actadr[servo]] = entry + lag
        data.qvel[model.jnt_dofadr[model.joint("approach").id]] = speed
        data.ctrl[servo] = speed
        self._advance(-entry / speed + self.settings.settle_s)
        self._check_sound()

    def _clear_until(self) -> float:
        """A place on the approach (metres, up to 0) before which the open hand is clear."""
        steps = math.ceil(self.settings.standoff_m / _SWEEP_M)
        places = np.linspace(-self.settings.standoff_m, 0.0, steps + 1)
        every = max(1, round(_RECORD_S * self.settings.approach_speed / _SWEEP_M))
        certain = int(self.scene.clear_m() / _SWEEP_M) if self.record is None else 0
        for k in range(certain, steps + 1):
            self.scene.move_hand(places[k])
            if k % every == 0:
                self._show()
            if self.scene.hand_touches():
                return float(places[max(0, k - 2)])
        return 0.0

    def _close(self) -> None:
        """Close until nothing changes any more, or until the time limit."""
        self.phase = "close"
        rule = self.equilibrium
        before = self._state()
        for _ in range(math.ceil(rule.limit_s / rule.window_s)):
            self._squeeze(rule.window_s)
            now = self._state()
            if all(np.abs(new - old).max() < 1.0 for new, old in zip(now, before, strict=True)):
                break
            before = now
        self._check_sound()

    def _state(self) -> tuple[ndarray, ndarray, ndarray]:
        """Coordinates, the object's centroid and forces, in units of what may change at rest."""
        scene, data = self.scene, self.data
        centroid = data.xipos[scene.object_body] / self.equilibrium.motion_m
        return centroid, data.qpos * scene.still_qpos, data.actuator_force * scene.still_force

    def _squeeze(self, seconds: float) -> None:
        """Let time pass while the closing command goes on its way, equilibrium or not."""
        closing, scene = self.closing, self.scene
        left = round(seconds / _COMMAND_S)
        while left > 0 and self.closing_s < closing.seconds:
            self.closing_s += _COMMAND_S
            part = min(1.0, self.closing_s / closing.seconds)
            for name, start in closing.open.items():
                command = start + part * (closing.close[name] - start)
                self.data.ctrl[scene.hand_ctrl[name]] = command
            self._advance(_COMMAND_S)
            left -= 1
        if left > 0:
            self._advance(left * _COMMAND_S)

    def _lift(self) -> tuple[bool, Reason, float]:
        """Move up, and compare where the object is in the hand with where it was."""
        scene, settings, data = self.scene, self.settings, self.data
        self.phase = "lift"
        at_grasp = scene.centroid_in_base()
        gripped = scene.parts_on_object() >= 2
        steadiness = Steadiness(scene, at_grasp)
        servo = self.model.actuator("lift").id
        scene.lock_approach()
        lifted = 0.0
        while True:
            touch = scene.touch()
            closed = self.closing_s >= self.closing.seconds
            if self.early_stop and closed and not touch.hand_object:
                remaining = settings.lift_height_m - data.qpos[scene.lift_qpos]
                final = left_behind_m(scene, at_grasp, remaining)
                if final is not None:
                    return False, "dropped" if gripped else "missed", final
            if self.early_stop and lifted > 0 and steadiness.certain(lifted, touch):
                break
            if lifted >= settings.lift_s - 1e-9:
                break
            while lifted < settings.lift_ramp_s - 1e-9:
                lifted += _COMMAND_S
                data.ctrl[servo] = settings.lift_speed * min(1.0, lifted / settings.lift_ramp_s)
                self._squeeze(_COMMAND_S)
            chunk = min(_CHECK_S, settings.lift_s - lifted)
            self._squeeze(chunk)
            lifted += chunk
            self._check_sound()
        offset = float(np.linalg.norm(scene.centroid_in_base() - at_grasp))
        if offset <= settings.tolerance_m:
            return True, "held", offset
        if touch.hand_object:
            return False, "slipped", offset
        return False, "dropped" if gripped else "missed", offset

    def _advance(self, seconds: float) -> None:
        """Let time pass; in smaller pieces, but the same steps, if somebody watches."""
        steps = round(seconds / self.settings.timestep)
        piece = steps
        if self.record is not None:
            piece = max(1, round(_RECORD_S / self.settings.timestep))
        done = 0
        while done < steps:
            count = min(piece, steps - done)
            mujoco.mj_step(self.model, self.data, nstep=count)
            done += count
            self._show()
        self.steps += steps

    def _check_sound(self) -> None:
        if self.scene.exploded():
            raise _BlowUpError

    def _show(self) -> None:
        if self.record is not None:
            self.record(self.model, self.data, self.phase)


def _digest(grasp_object: GraspObject, gripper: Gripper, settings: TrialSettings) -> str:
    parts: list[str | ndarray] = []
    for piece in grasp_object.pieces:
        if isinstance(piece, ConvexPiece):
            parts.append(np.asarray(piece.vertices, dtype=np.float64))
        else:
            parts.append(json.dumps([piece.kind, *piece.size]))
            parts.append(np.asarray(piece.obj_T_geom, dtype=np.float64))
    physical = (grasp_object.mass_kg, grasp_object.friction)
    inertial = (physical, grasp_object.centroid, grasp_object.inertia, grasp_object.sim_T_ref)
    parts += [np.asarray(values, dtype=np.float64) for values in inertial]
    return sha256(*parts, grasp_object.name, gripper_digest(gripper), settings.digest())
