"""Scene of the trials of an object by a gripper: the compiled MuJoCo model and its state.

The pose of the grasp is that of one body between the arm's two slides. It is set for each trial, so
the model is compiled once for all estimates.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import MismatchError
from graspcast.pose.transforms import invert, quaternion, rotation_from_quaternion
from graspcast.simulation.engine import mujoco
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.mujoco_messages import compile_spec
from graspcast.simulation.objects.types import ConvexPiece, GraspObject, box_corners
from graspcast.simulation.trial.scene_spec import ARM_STIFFNESS, scene_spec, set_solver
from graspcast.simulation.trial.settings import TrialSettings

__all__ = ["HAND", "OBJECT", "TABLE", "Contacts", "Scene", "build_scene"]

TABLE, OBJECT, HAND = 0, 1, 2
_REST_S = 1.0
_REST_SHIFT_M, _REST_TURN_RAD = 0.01, 0.1
_PARKED_M = 10.0
_MAX_OBJECT_SPEED, _MAX_SPEED = 20.0, 1e4


class Contacts(NamedTuple):
    """Which kinds of geoms are in contact with the object in the current state."""

    hand_object: bool
    table_object: bool


@dataclass(frozen=True, eq=False)
class Scene:
    """Compiled model of a scene, one state of it, and the indices of its parts in both.

    Only :meth:`place`, :meth:`set_grip_solver` and :meth:`lock_approach` change ``model``: the pose
    of the arm's mount, the force limit of its approach, and the solver's options. ``place`` sets
    all of them.

    Attributes
    ----------
    model, data
        MuJoCo's model and state.
    settings
        How the trials are run.
    kind
        For each geom: table 0, object 1, hand 2; -9 for geoms that do not collide.
    object_body, base_body, mount_body
        Body numbers of the object, the hand's base and the arm's mount.
    object_qpos, approach_qpos, lift_qpos
        Positions of the object's pose and of the arm's slides in ``data.qpos``.
    lift_ctrl
        Actuator number of the lift.
    hand_joints
        Joint numbers of the hand.
    joint_levers
        Factor that turns a motion of each joint of the hand into metres.
    hand_ctrl
        Actuator's name to its number.
    still_qpos
        Factor that turns a change of each coordinate into a multiple of the largest change at
        equilibrium; zero for the arm and for the object's position, which counts by its centroid.
    still_force
        The same for the force of each actuator.
    rest_qpos, rest_act
        State at rest, in which every trial starts.
    object_radius_m
        Radius of a sphere about the centroid that contains the object.
    hand_reach_m
        Radius of a sphere about the base that contains the hand in any posture.
    """

    model: Any
    data: Any
    settings: TrialSettings
    kind: ndarray
    object_body: int
    base_body: int
    mount_body: int
    object_qpos: slice
    approach_qpos: int
    lift_qpos: int
    lift_ctrl: int
    hand_joints: ndarray
    joint_levers: ndarray
    hand_ctrl: dict[str, int]
    still_qpos: ndarray
    still_force: ndarray
    rest_qpos: ndarray
    rest_act: ndarray
    object_radius_m: float
    hand_reach_m: float

    def place(self, sim_T_base: Float[ndarray, "4 4"], approach_m: float) -> None:
        """Reset to rest, the hand's base ``approach_m`` along the approach from ``sim_T_base``."""
        set_solver(self.model.opt, self.settings.solver)
        mujoco.mj_resetData(self.model, self.data)
        self.model.body_pos[self.mount_body] = sim_T_base[:3, 3]
        mujoco.mju_mat2Quat(self.model.body_quat[self.mount_body], sim_T_base[:3, :3].ravel())
        servo = self.model.actuator("approach").id
        limit = self.settings.arm_force_n
        self.model.actuator_forcerange[servo] = -limit, limit
        self.data.qpos[:] = self.rest_qpos
        self.data.act[:] = self.rest_act
        self.move_hand(approach_m)

    def park(self) -> None:
        """Reset to rest, with the hand high above the object."""
        parked = np.eye(4)
        parked[2, 3] = _PARKED_M
        self.place(parked, 0.0)

    def set_grip_solver(self) -> None:
        """Set the solver that applies from when the hand grips."""
        set_solver(self.model.opt, self.settings.grip_solver)

    def lock_approach(self) -> None:
        """Hold the hand at its current place on the approach, with its current force."""
        servo = self.model.actuator("approach").id
        lead = self.data.actuator_force[servo] / ARM_STIFFNESS
        self.data.act[self.model.actuator_actadr[servo]] = self.data.qpos[self.approach_qpos] + lead
        self.data.ctrl[servo] = 0.0
        self.model.actuator_forcerange[servo] = -np.inf, np.inf

    def move_hand(self, approach_m: float) -> None:
        """Set the hand's place on the approach, metres, without a time step."""
        self.data.qpos[self.approach_qpos] = approach_m
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)

    def hand_in_contact(self) -> bool:
        """Return whether the hand touches anything."""
        return HAND in self.kind[self.data.contact.geom]

    def hand_overlap_m(self, *, with_table: bool = True) -> float:
        """Return the penetration of the hand into object or table, metres; -inf without contact."""
        contact = self.data.contact
        if not self.data.ncon:
            return -np.inf
        kinds = self.kind[contact.geom]
        chosen = (kinds == HAND).any(axis=1)
        if not with_table:
            chosen &= (kinds == OBJECT).any(axis=1)
        depths: ndarray = -contact.dist[chosen]
        return float(depths.max()) if len(depths) else -np.inf

    def contacts(self) -> Contacts:
        """Return what is in contact with the object."""
        if not self.data.ncon:
            return Contacts(hand_object=False, table_object=False)
        pairs = self.kind[self.data.contact.geom].sum(axis=1).tolist()
        return Contacts(hand_object=HAND + OBJECT in pairs, table_object=TABLE + OBJECT in pairs)

    def parts_on_object(self) -> int:
        """Return the number of bodies of the hand that touch the object."""
        geoms = self.data.contact.geom
        kinds = self.kind[geoms]
        on_object = kinds.sum(axis=1) == HAND + OBJECT
        parts = self.model.geom_bodyid[geoms[on_object][kinds[on_object] == HAND]]
        return len(set(parts.tolist()))

    def centroid_in_base(self) -> Float[ndarray, " 3"]:
        """Return the object's centroid in the hand's base frame, metres."""
        base = self.data.xmat[self.base_body].reshape(3, 3)
        world = self.data.xipos[self.object_body] - self.data.xpos[self.base_body]
        offset: ndarray = base.T @ world
        return offset

    def posture(self) -> Float[ndarray, " j"]:
        """Return the joint positions of the hand, metres; of a hinge, the arc at its lever."""
        joints = self.data.qpos[self.model.jnt_qposadr[self.hand_joints]]
        posture: ndarray = joints * self.joint_levers
        return posture

    def hand_speed(self) -> float:
        """Return the speed of the fastest joint of the hand, m/s; of a hinge, at its lever."""
        speeds = self.data.qvel[self.model.jnt_dofadr[self.hand_joints]] * self.joint_levers
        return float(np.abs(speeds).max())

    def hand_saturated(self) -> bool:
        """Return whether every actuator of the hand exerts its largest force."""
        actuators = list(self.hand_ctrl.values())
        limits = np.abs(self.model.actuator_forcerange[actuators]).max(axis=1)
        forces = np.abs(self.data.actuator_force[actuators])
        return bool(((limits > 0) & (forces > 0.999 * limits)).all())

    def grip_n(self) -> float:
        """Return the horizontal force with which the hand presses on each side of the object, N.

        Half of the sum over all contacts, as if there were two sides.
        """
        total, force = 0.0, np.zeros(6)
        kinds = self.kind[self.data.contact.geom].sum(axis=1) if self.data.ncon else []
        for i in np.flatnonzero(np.asarray(kinds) == HAND + OBJECT).tolist():
            mujoco.mj_contactForce(self.model, self.data, i, force)
            total += force[0] * float(np.linalg.norm(self.data.contact.frame[i, :2]))
        return total / 2

    def hand_boxes(self) -> tuple[ndarray, ndarray]:
        """Return the bounding boxes of the hand's geoms: lower and upper corners, (g, 3)."""
        return self._boxes(HAND)

    def object_boxes(self) -> tuple[ndarray, ndarray]:
        """Return the bounding boxes of the object's pieces: lower and upper corners, (g, 3)."""
        return self._boxes(OBJECT)

    def _boxes(self, kind: int) -> tuple[ndarray, ndarray]:
        """Return the world-aligned bounding boxes of the geoms of a kind."""
        chosen = np.flatnonzero(self.kind == kind)
        rotation = self.data.geom_xmat[chosen].reshape(-1, 3, 3)
        local = self.model.geom_aabb[chosen]
        middle = self.data.geom_xpos[chosen] + np.einsum("gij,gj->gi", rotation, local[:, :3])
        half = np.einsum("gij,gj->gi", np.abs(rotation), local[:, 3:])
        return middle - half, middle + half

    def clearance_m(self) -> float:
        """Return a distance that the hand can move in any direction without touching anything."""
        hand_low, hand_high = self.hand_boxes()
        low, high = self.object_boxes()
        gaps = np.maximum(low[:, None] - hand_high[None], hand_low[None] - high[:, None])
        above_table = hand_low[:, 2].min() if self.settings.hand_touches_table else np.inf
        return max(0.0, min(float(gaps.max(axis=2).min()), float(above_table)))

    def diverged(self) -> bool:
        """Return whether the simulation is unstable: a speed is not finite, or far too large."""
        speeds = self.data.qvel
        # A comparison with NaN is false. The object's free joint is the first.
        return not (
            speeds @ speeds < _MAX_SPEED**2 and speeds[:3] @ speeds[:3] < _MAX_OBJECT_SPEED**2
        )


def build_scene(grasp_object: GraspObject, gripper: Gripper, settings: TrialSettings) -> Scene:
    """Compile the scene, and let the object and the open hand come to rest far from each other.

    Raises
    ------
    MismatchError
        If the object does not stay in its reference pose.
    InputError
        If MuJoCo does not compile the scene.
    """
    model = compile_spec(
        scene_spec(grasp_object, gripper, settings),
        f"the scene of object {grasp_object.name!r} and gripper {gripper.name!r}",
    )
    data = mujoco.MjData(model)
    base = int(np.flatnonzero(model.body_parentid == model.body("mount").id)[0])
    # The base is at the mount, whatever its pose in the hand's own model.
    model.body_pos[base], model.body_quat[base] = 0.0, (1.0, 0.0, 0.0, 0.0)
    mujoco.mj_setConst(model, data)
    kind = np.full(model.ngeom, -9)
    colliding = (model.geom_contype | model.geom_conaffinity) != 0
    kind[model.geom_bodyid == 0] = TABLE
    kind[model.geom_bodyid == model.body("object").id] = OBJECT
    kind[(model.body_rootid[model.geom_bodyid] == model.body("lift").id) & colliding] = HAND
    arm = [model.joint(name).id for name in ("object", "lift", "approach")]
    joints = np.array([j for j in range(model.njnt) if j not in arm], dtype=int)
    start = model.jnt_qposadr[model.joint("object").id]
    controls = {name: model.actuator("hand/" + name).id for name in gripper.closing.open}
    levers = np.where(
        model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_SLIDE, 1.0, gripper.equilibrium.lever_m
    )
    still_qpos, still_force = np.zeros(model.nq), np.zeros(model.nu)
    rule, radius = gripper.equilibrium, _radius(grasp_object)
    # Half the angle of a small turn is the change of its quaternion.
    still_qpos[start + 3 : start + 7] = 2.0 * radius / rule.motion_m
    still_qpos[model.jnt_qposadr[joints]] = levers / rule.motion_m
    for actuator in controls.values():
        limit = float(np.abs(model.actuator_forcerange[actuator]).max())
        still_force[actuator] = 1.0 / (rule.force_fraction * (limit or 1.0))
    scene = Scene(
        model=model,
        data=data,
        settings=settings,
        kind=kind,
        object_body=model.body("object").id,
        base_body=base,
        mount_body=model.body("mount").id,
        object_qpos=slice(start, start + 7),
        approach_qpos=int(model.jnt_qposadr[model.joint("approach").id]),
        lift_qpos=int(model.jnt_qposadr[model.joint("lift").id]),
        lift_ctrl=model.actuator("lift").id,
        hand_joints=joints,
        joint_levers=levers,
        hand_ctrl=controls,
        still_qpos=still_qpos,
        still_force=still_force,
        rest_qpos=np.zeros(model.nq),
        rest_act=np.zeros(model.na),
        object_radius_m=radius,
        hand_reach_m=_reach(model, base, kind == HAND),
    )
    _rest(scene, grasp_object, gripper)
    return scene


def _radius(grasp_object: GraspObject) -> float:
    """Return the radius of a sphere about the centroid that contains every collision piece."""
    radii = []
    for piece in grasp_object.pieces:
        if isinstance(piece, ConvexPiece):
            points = piece.vertices
        else:
            size = piece.size
            half = {"box": size, "cylinder": (size[0], size[0], size[-1]), "sphere": 3 * size[:1]}
            corners = box_corners(half[piece.kind])
            points = corners @ piece.obj_T_geom[:3, :3].T + piece.obj_T_geom[:3, 3]
        radii.append(np.linalg.norm(points - grasp_object.centroid, axis=1).max())
    return float(max(radii))


def _reach(model: Any, base: int, of_hand: ndarray) -> float:
    """Return a bound on the distance of any part of the hand from its base, in any posture."""
    body_reach = {base: 0.0}
    for body in range(base + 1, model.nbody):
        parent = int(model.body_parentid[body])
        if parent not in body_reach:
            continue
        reach = body_reach[parent] + float(np.linalg.norm(model.body_pos[body]))
        first = model.body_jntadr[body]
        for joint in range(first, first + model.body_jntnum[body]):
            reach += 2.0 * float(np.linalg.norm(model.jnt_pos[joint]))
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
                limited = model.jnt_limited[joint]
                reach += float(np.abs(model.jnt_range[joint]).max()) if limited else np.inf
        body_reach[body] = reach
    geoms = np.flatnonzero(of_hand)
    return max(
        body_reach[int(model.geom_bodyid[g])]
        + float(np.linalg.norm(model.geom_pos[g]) + model.geom_rbound[g])
        for g in geoms
    )


def _rest(scene: Scene, grasp_object: GraspObject, gripper: Gripper) -> None:
    """Compute the state in which every trial starts: open hand and object, both at rest."""
    model, data = scene.model, scene.data
    scene.rest_qpos[:] = model.qpos0
    reference = grasp_object.sim_T_ref
    scene.rest_qpos[scene.object_qpos] = (*reference[:3, 3], *quaternion(reference[:3, :3]))
    scene.park()
    for name, value in gripper.closing.open.items():
        data.ctrl[scene.hand_ctrl[name]] = value
    mujoco.mj_step(model, data, nstep=round(_REST_S / model.opt.timestep))
    if scene.diverged():
        raise MismatchError(
            f"the simulation of {grasp_object.name!r} at rest and the open gripper "
            f"{gripper.name!r}, far from each other, is unstable within {_REST_S:g} s; check the "
            "gripper's servos (more damping and armature, less stiffness) and the object's inertia"
        )
    placed = np.eye(4)
    placed[:3, 3] = data.qpos[scene.object_qpos][:3]
    placed[:3, :3] = rotation_from_quaternion(data.qpos[scene.object_qpos][3:])
    ref_T_placed = invert(reference) @ placed
    shift = float(np.linalg.norm(placed[:3, 3] - reference[:3, 3]))
    turn = float(np.arccos(np.clip(0.5 * (np.trace(ref_T_placed[:3, :3]) - 1.0), -1.0, 1.0)))
    if not (shift <= _REST_SHIFT_M and turn <= _REST_TURN_RAD):
        raise MismatchError(
            f"object {grasp_object.name!r} does not rest in its reference pose: it "
            f"moves by {1e3 * shift:.1f} mm and {np.degrees(turn):.1f} degrees in {_REST_S:g} s; "
            "give a pose in which it stands on the plane z = 0"
        )
    scene.rest_qpos[:] = data.qpos
    scene.rest_act[:] = data.act
    for index in (scene.approach_qpos, scene.lift_qpos):
        scene.rest_qpos[index] = 0.0
    for name in ("lift", "approach"):
        scene.rest_act[model.actuator_actadr[model.actuator(name).id]] = 0.0
