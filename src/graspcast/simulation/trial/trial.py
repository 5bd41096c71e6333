"""Grasp trial: a grasp guided by a pose estimate, run in simulation (Sections III-B and IV-C)."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import MismatchError
from graspcast.io.hashing import sha256
from graspcast.pose.transforms import compose, invert
from graspcast.simulation.engine import mujoco
from graspcast.simulation.grippers.protocol import Equilibrium, Gripper, gripper_digest
from graspcast.simulation.objects.types import ConvexPiece, Grasp, GraspObject, check_rigid
from graspcast.simulation.trial.collision import SAMPLE_S, Approach, CollisionMonitor
from graspcast.simulation.trial.early_stopping import (
    CHECK_S,
    HoldMonitor,
    above_table,
    left_behind_offset_m,
    out_of_reach,
)
from graspcast.simulation.trial.outcome import REASONS, Outcome, Reason
from graspcast.simulation.trial.scene import Scene, build_scene
from graspcast.simulation.trial.settings import TrialSettings

__all__ = [
    "REASONS",
    "Outcome",
    "Reason",
    "Record",
    "TrialRunner",
    "TrialSettings",
    "trial_digest",
]

Record = Callable[[Any, Any, str], None]
"""Called as ``record(model, data, phase)`` before the first step and about every 20 ms of a trial.

The phases are "approach", "close" and "lift". The state must not be changed.
"""

_SWEEP_M = 0.002
_COMMAND_S, _RECORD_S = 0.02, 0.02


class TrialRunner:
    """Run trials of one object with one gripper; the model is compiled once.

    The same input gives bitwise the same outcome, whatever the runner ran before. A runner has one
    simulation state, so each thread or process needs its own.

    Parameters
    ----------
    grasp_object
        The object.
    gripper
        The gripper.
    settings
        How the trials are run; the robot's protocol with the gripper's limits if None.

    Attributes
    ----------
    digest
        SHA-256 of the object, the gripper and every setting, as hex.
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
        self.settings = settings or TrialSettings.robot(gripper)
        self.mujoco_version: str = mujoco.__version__
        self.scene = build_scene(grasp_object, gripper, self.settings)
        self.digest = trial_digest(grasp_object, gripper, self.settings)
        self._tcp_T_base = invert(gripper.base_T_tcp)
        self._equilibrium = gripper.equilibrium

    def sim_T_base(self, obj_T_est: Float[ndarray, "4 4"], grasp: Grasp) -> Float[ndarray, "4 4"]:
        """Return the pose of the hand's base: the reference grasp transferred to the estimate."""
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
        """Run the trial of the grasp that an estimate would guide.

        Parameters
        ----------
        obj_T_est
            The estimate in the true object's frame, ``inv(cam_T_gt) @ cam_T_est``; the identity for
            a perfect estimate.
        grasp
            Reference grasp of this object by this gripper.
        early_stop
            Whether to stop as soon as the outcome can no longer change; the label is the same.
        record
            Called during the trial, for pictures; does not change the outcome.

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
        trial = _Trial(
            self.scene, self.gripper, self._equilibrium, early_stop=early_stop, record=record
        )
        return trial.run(self.sim_T_base(obj_T_est, grasp))


class _UnstableError(Exception):
    """The simulation is unstable."""


class _Trial:
    """One trial on a scene."""

    def __init__(
        self,
        scene: Scene,
        gripper: Gripper,
        equilibrium: Equilibrium,
        *,
        early_stop: bool,
        record: Record | None,
    ):
        self.scene, self.gripper, self.settings = scene, gripper, scene.settings
        self.closing, self.equilibrium = gripper.closing, equilibrium
        self.model, self.data = scene.model, scene.data
        self.early_stop, self.record = early_stop, record
        self.phase = "approach"
        self.closing_s = 0.0
        self.steps = 0
        self.approach: Approach | None = None

    def run(self, sim_T_base: Float[ndarray, "4 4"]) -> Outcome:
        started = time.perf_counter()
        try:
            success, reason, offset = self._phases(sim_T_base)
        except _UnstableError:
            success, reason, offset = False, "unstable", math.nan
        return Outcome(
            success=success,
            reason=reason,
            offset_m=offset,
            simulated_s=self.steps * self.settings.timestep,
            computed_s=time.perf_counter() - started,
            steps=self.steps,
            **({} if self.approach is None else self.approach._asdict()),
        )

    def _phases(self, sim_T_base: Float[ndarray, "4 4"]) -> tuple[bool, Reason, float]:
        scene, settings = self.scene, self.settings
        scene.place(sim_T_base, -settings.standoff_m)
        self._call_record()
        if scene.hand_overlap_m() > settings.overlap_m:
            return False, "blocked", math.nan
        if self._overlaps_at_goal():
            return False, "blocked", math.nan
        end = sim_T_base[:3, 3]
        start = end - settings.standoff_m * sim_T_base[:3, :3] @ self.gripper.base_T_tcp[:3, 2]
        watched = settings.protocol == "robot"
        self.approach = Approach() if watched else None
        never = self.early_stop and out_of_reach(scene, start, end)
        # A hand that never comes near the object may still meet the table.
        if never and not (watched and not above_table(scene, start, end)):
            return False, "missed", settings.lift_height_m
        if self._approach(CollisionMonitor(scene) if watched else None):
            return False, "collided", math.nan
        if never:
            return False, "missed", settings.lift_height_m
        self._close()
        return self._lift()

    def _overlaps_at_goal(self) -> bool:
        """Return whether the open hand at its goal would be too deep in the resting object."""
        limit, scene = self.settings.goal_overlap_m, self.scene
        if limit is None:
            return False
        scene.move_hand(0.0)
        found = scene.hand_overlap_m(with_table=False) > limit
        scene.move_hand(-self.settings.standoff_m)
        return found

    def _approach(self, monitor: CollisionMonitor | None) -> bool:
        """Move to the grasp, open-loop; simulate only the part where contact is possible.

        Before that the object rests and the hand is rigid, so simulating it would change nothing.
        Return whether the monitor found a collision.
        """
        scene, data, model = self.scene, self.data, self.model
        for name, value in self.closing.open.items():
            data.ctrl[scene.hand_ctrl[name]] = value
        entry = self._clear_until()
        scene.move_hand(entry)
        if entry == 0.0:
            return False
        servo = model.actuator("approach").id
        speed = self.settings.approach_speed
        # In steady motion the servo's set point leads by the lag that its damping causes.
        lag = speed * abs(model.actuator_biasprm[servo, 2] / model.actuator_gainprm[servo, 0])
        data.act[model.actuator_actadr[servo]] = entry + lag
        data.qvel[model.jnt_dofadr[model.joint("approach").id]] = speed
        data.ctrl[servo] = speed
        seconds = -entry / speed + self.settings.settle_s
        if monitor is None:
            self._advance(seconds)
        else:
            self._advance_watched(seconds, monitor)
        self._check_stable()
        return monitor is not None and monitor.collided()

    def _advance_watched(self, seconds: float, monitor: CollisionMonitor) -> None:
        """Simulate some time of the approach, or until the monitor stops the arm."""
        left = round(seconds / self.settings.timestep)
        every = max(1, round(SAMPLE_S / self.settings.timestep))
        stopped = False
        while left > 0 and not stopped:
            count = min(every, left)
            self._advance_steps(count)
            left -= count
            stopped = monitor.should_stop(self.steps * self.settings.timestep)
        self.approach = monitor.result()

    def _clear_until(self) -> float:
        """Return a place on the approach (metres, at most 0) up to which the open hand is clear."""
        steps = math.ceil(self.settings.standoff_m / _SWEEP_M)
        places = np.linspace(-self.settings.standoff_m, 0.0, steps + 1)
        every = max(1, round(_RECORD_S * self.settings.approach_speed / _SWEEP_M))
        first = int(self.scene.clearance_m() / _SWEEP_M) if self.record is None else 0
        for k in range(first, steps + 1):
            self.scene.move_hand(places[k])
            if k % every == 0:
                self._call_record()
            if self.scene.hand_in_contact():
                return float(places[max(0, k - 2)])
        return 0.0

    def _close(self) -> None:
        """Close until equilibrium, or until the time limit."""
        self.phase = "close"
        rule = self.equilibrium
        before = self._state()
        for _ in range(math.ceil(rule.limit_s / rule.window_s)):
            self._advance_closing(rule.window_s)
            now = self._state()
            if all(np.abs(new - old).max() < 1.0 for new, old in zip(now, before, strict=True)):
                break
            if self.scene.parts_on_object() >= 2:
                self.scene.set_grip_solver()
            before = now
        self._check_stable()

    def _state(self) -> tuple[ndarray, ndarray, ndarray]:
        """Return centroid, coordinates and forces, in units of the change allowed at rest."""
        scene, data = self.scene, self.data
        centroid = data.xipos[scene.object_body] / self.equilibrium.motion_m
        return centroid, data.qpos * scene.still_qpos, data.actuator_force * scene.still_force

    def _advance_closing(self, seconds: float) -> None:
        """Simulate some time, during which the ramp of the closing command goes on."""
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
        """Move up, and compare the object's place in the hand with that before the lift."""
        scene, settings, data = self.scene, self.settings, self.data
        self.phase = "lift"
        at_grasp = scene.centroid_in_base()
        gripped = scene.parts_on_object() >= 2
        hold = HoldMonitor(scene, at_grasp)
        scene.set_grip_solver()
        scene.lock_approach()
        lifted = 0.0
        while True:
            contacts = scene.contacts()
            closed = self.closing_s >= self.closing.seconds
            if self.early_stop and closed and not contacts.hand_object:
                remaining = settings.lift_height_m - data.qpos[scene.lift_qpos]
                final = left_behind_offset_m(scene, at_grasp, remaining)
                if final is not None:
                    return False, "dropped" if gripped else "missed", final
            if self.early_stop:
                pressing = closed or scene.hand_saturated()
                if hold.should_stop(lifted, contacts, pressing=pressing):
                    break
            if lifted >= settings.lift_s - 1e-9:
                break
            lifted = self._advance_lift(lifted, min(CHECK_S, settings.lift_s - lifted))
            self._check_stable()
        offset = float(np.linalg.norm(scene.centroid_in_base() - at_grasp))
        if offset <= settings.tolerance_m:
            return True, "held", offset
        if contacts.hand_object:
            return False, "slipped", offset
        return False, "dropped" if gripped else "missed", offset

    def _advance_lift(self, lifted: float, seconds: float) -> float:
        """Simulate some time of the lift, and return the time since its start."""
        end, ramp = lifted + seconds, self.settings.lift_ramp_s
        while lifted < min(end, ramp) - 1e-9:
            lifted += _COMMAND_S
            self._command_lift(min(1.0, lifted / ramp))
            self._advance_closing(_COMMAND_S)
        if lifted < end - 1e-9:
            self._command_lift(1.0)
            self._advance_closing(end - lifted)
        return max(lifted, end)

    def _command_lift(self, share: float) -> None:
        """Command a share of the lift's speed."""
        self.data.ctrl[self.scene.lift_ctrl] = share * self.settings.lift_speed

    def _advance(self, seconds: float) -> None:
        """Simulate some time."""
        self._advance_steps(round(seconds / self.settings.timestep))

    def _advance_steps(self, steps: int) -> None:
        """Simulate some steps; if recorded, the same ones in shorter intervals."""
        interval = steps
        if self.record is not None:
            interval = max(1, round(_RECORD_S / self.settings.timestep))
        done = 0
        while done < steps:
            count = min(interval, steps - done)
            mujoco.mj_step(self.model, self.data, nstep=count)
            done += count
            self._call_record()
        self.steps += steps

    def _check_stable(self) -> None:
        if self.scene.diverged():
            raise _UnstableError

    def _call_record(self) -> None:
        if self.record is not None:
            self.record(self.model, self.data, self.phase)


def trial_digest(grasp_object: GraspObject, gripper: Gripper, settings: TrialSettings) -> str:
    """Return the SHA-256 of an object, a gripper and every setting of a trial, as hex."""
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
