"""One MuJoCo model for all trials of an object and a gripper: table, object, arm and hand.

The arm is two stiff, force-limited slides: ``lift`` moves up along the world's z, and on it
``approach`` moves along the approach direction of the hand. Where the hand goes is the pose of
the body between the two, written anew for each trial, so that one compiled model serves every
estimate. The hand keeps its orientation and, sideways, its place: the rigid, open-loop control of
the paper's Section III-B.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import MismatchError
from graspcast.geometry import invert, quaternion, rotation_from_quaternion
from graspcast.grasping.gripper import Gripper
from graspcast.grasping.settings import TrialSettings
from graspcast.grasping.types import ConvexPiece, GraspObject

__all__ = ["HAND", "OBJECT", "TABLE", "Scene", "Touch", "build_scene"]

TABLE, OBJECT, HAND = 0, 1, 2
# Bits of contype; what an element feels is the other's contype in its own conaffinity.
_OBJECT_BIT, _TABLE_BIT, _HAND_BIT = 1, 2, 4
_ARM_STIFFNESS, _ARM_KG = 1e5, 10.0
_ARM_DAMPING = 2.0 * np.sqrt(_ARM_STIFFNESS * _ARM_KG)
_REST_S = 1.0
_REST_SHIFT_M, _REST_TURN_RAD = 0.01, 0.1
_PARKED_M = 10.0
_TOO_FAST, _ABSURD = 20.0, 1e4


@dataclass(frozen=True)
class Touch:
    """Who touches whom in the current state."""

    hand_object: bool
    table_object: bool
    hand_bodies: int
    """How many parts of the hand touch the object."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The compiled model, one state of it, and where things are in both.

    ``model`` is changed by :meth:`place` and :meth:`lock_approach` alone, in the pose of the arm's
    mount and the force of its approach; ``place`` sets both anew.
    """

    model: Any
    data: Any
    settings: TrialSettings
    kind: ndarray
    """For every geom: table 0, object 1, hand 2."""
    object_body: int
    base_body: int
    mount_body: int
    object_qpos: slice
    approach_qpos: int
    lift_qpos: int
    hand_joints: ndarray
    joint_levers: ndarray
    """For each joint of the hand, what turns its motion into metres."""
    hand_ctrl: dict[str, int]
    largest_force: ndarray
    """Of each actuator in ``hand_ctrl``, its force limit; or 1 where it has none."""
    rest_qpos: ndarray
    rest_act: ndarray
    object_radius_m: float
    """Of the sphere about the centroid that holds the object."""
    hand_reach_m: float
    """Of the sphere about the base that holds the hand in any posture."""

    def place(self, sim_T_base: Float[ndarray, "4 4"], approach_m: float) -> None:
        """Reset to rest with the hand ``approach_m`` along the approach from ``sim_T_base``."""
        mujoco.mj_resetData(self.model, self.data)
        self.model.body_pos[self.mount_body] = sim_T_base[:3, 3]
        self.model.body_quat[self.mount_body] = quaternion(sim_T_base[:3, :3])
        servo = self.model.actuator("approach").id
        limit = self.settings.arm_force_n
        self.model.actuator_forcerange[servo] = -limit, limit
        self.data.qpos[:] = self.rest_qpos
        self.data.act[:] = self.rest_act
        self.move_hand(approach_m)

    def park(self) -> None:
        """Reset to rest with the hand high above the object."""
        parked = np.eye(4)
        parked[2, 3] = _PARKED_M
        self.place(parked, 0.0)

    def lock_approach(self) -> None:
        """Hold the hand where it is along its approach, with the force that it has now."""
        servo = self.model.actuator("approach").id
        lead = self.data.actuator_force[servo] / _ARM_STIFFNESS
        self.data.act[self.model.actuator_actadr[servo]] = self.data.qpos[self.approach_qpos] + lead
        self.data.ctrl[servo] = 0.0
        self.model.actuator_forcerange[servo] = -np.inf, np.inf

    def move_hand(self, approach_m: float) -> None:
        """Put the resting hand elsewhere on its approach, without time passing."""
        self.data.qpos[self.approach_qpos] = approach_m
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)

    def hand_overlap_m(self) -> float:
        """How deep the hand is in the object or the table; negative infinity if it is clear."""
        contact = self.data.contact
        if not self.data.ncon:
            return -np.inf
        depths: ndarray = -contact.dist[(self.kind[contact.geom] == HAND).any(axis=1)]
        return float(depths.max()) if len(depths) else -np.inf

    def touch(self) -> Touch:
        """Who touches whom."""
        if not self.data.ncon:
            return Touch(hand_object=False, table_object=False, hand_bodies=0)
        geoms = self.data.contact.geom
        kinds = self.kind[geoms]
        total = kinds.sum(axis=1)
        grip = total == HAND + OBJECT
        held_by = self.model.geom_bodyid[geoms[grip][kinds[grip] == HAND]]
        return Touch(
            hand_object=bool(grip.any()),
            table_object=bool((total == TABLE + OBJECT).any()),
            hand_bodies=len(set(held_by.tolist())),
        )

    def centroid_in_base(self) -> Float[ndarray, " 3"]:
        """The object's centroid in the hand's base frame, metres."""
        base = self.data.xmat[self.base_body].reshape(3, 3)
        world = self.data.xipos[self.object_body] - self.data.xpos[self.base_body]
        offset: ndarray = base.T @ world
        return offset

    def posture(self) -> Float[ndarray, " j"]:
        """Positions of the hand's joints in metres; a hinge counts by its arc at its lever."""
        joints = self.data.qpos[self.model.jnt_qposadr[self.hand_joints]]
        posture: ndarray = joints * self.joint_levers
        return posture

    def hand_speed(self) -> float:
        """Of the fastest joint of the hand, m/s; a hinge counts by its arc at its lever."""
        speeds = self.data.qvel[self.model.jnt_dofadr[self.hand_joints]] * self.joint_levers
        return float(np.abs(speeds).max())

    def boxes(self, of: int) -> tuple[ndarray, ndarray]:
        """Lower and upper corners of world-aligned boxes about the geoms of a kind."""
        chosen = np.flatnonzero(self.kind == of)
        rotation = self.data.geom_xmat[chosen].reshape(-1, 3, 3)
        local = self.model.geom_aabb[chosen]
        middle = self.data.geom_xpos[chosen] + np.einsum("gij,gj->gi", rotation, local[:, :3])
        half = np.einsum("gij,gj->gi", np.abs(rotation), local[:, 3:])
        return middle - half, middle + half

    def hand_boxes(self) -> tuple[ndarray, ndarray]:
        """Boxes about the colliding geoms of the hand."""
        return self.boxes(HAND)

    def object_boxes(self) -> tuple[ndarray, ndarray]:
        """Boxes about the pieces of the object."""
        return self.boxes(OBJECT)

    def exploded(self) -> bool:
        """Whether anything is not finite, or faster than what here falls or is thrown can be."""
        speeds = np.abs(self.data.qvel)
        # A comparison with NaN is false. The object's free joint is the first.
        return not (speeds.max() < _ABSURD and speeds[:3].max() < _TOO_FAST)


def _ignore(message: str) -> None:
    """In place of MuJoCo's warnings of instability, which a trial counts as an outcome."""


def build_scene(grasp_object: GraspObject, gripper: Gripper, settings: TrialSettings) -> Scene:
    """Compile the scene and let object and open hand come to rest, far from each other.

    Raises:
        MismatchError: if the object does not stay in its reference pose.
    """
    if mujoco.get_mju_user_warning() is None:
        # By default MuJoCo writes a log file into the working directory.
        mujoco.set_mju_user_warning(_ignore)
    spec = mujoco.MjSpec()
    _set_options(spec, settings)
    table = spec.worldbody.add_geom(
        name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 0.05), condim=1
    )
    _add_object(spec, grasp_object, settings)
    _add_arm_and_hand(spec, gripper, settings)
    table.contype, table.conaffinity = _TABLE_BIT, _OBJECT_BIT
    table.solref, table.solimp = settings.solref, (*settings.solimp, 0.5, 2)
    table.rgba = (0.93, 0.92, 0.90, 1.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    base = int(np.flatnonzero(model.body_parentid == model.body("mount").id)[0])
    # The mount says where the base is, wherever the hand's own model has put it.
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
    actuators = [model.actuator("hand/" + name).id for name in gripper.closing.open]
    limits = np.abs(model.actuator_forcerange[actuators]).max(axis=1)
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
        hand_joints=joints,
        joint_levers=np.where(
            model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_SLIDE, 1.0, gripper.equilibrium.lever_m
        ),
        largest_force=np.where(limits > 0, limits, 1.0),
        hand_ctrl={name: model.actuator("hand/" + name).id for name in gripper.closing.open},
        rest_qpos=np.zeros(model.nq),
        rest_act=np.zeros(model.na),
        object_radius_m=_radius(grasp_object),
        hand_reach_m=_reach(model, base, kind == HAND),
    )
    _rest(scene, grasp_object, gripper)
    return scene


def _set_options(spec: Any, settings: TrialSettings) -> None:
    option = spec.option
    option.timestep = settings.timestep
    option.integrator = getattr(mujoco.mjtIntegrator, "mjINT_" + settings.integrator.upper())
    option.cone = getattr(mujoco.mjtCone, "mjCONE_" + settings.cone.upper())
    option.impratio = settings.impratio
    option.noslip_iterations = settings.noslip_iterations
    option.iterations = settings.iterations
    # A state that blew up is to be seen, not silently reset.
    option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    # Sorting so few bodies into islands takes longer than it saves.
    option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)


def _add_object(spec: Any, grasp_object: GraspObject, settings: TrialSettings) -> None:
    body = spec.worldbody.add_body(name="object")
    body.add_joint(
        name="object",
        type=mujoco.mjtJoint.mjJNT_FREE,
        align=mujoco.mjtAlignFree.mjALIGNFREE_FALSE,
    )
    moments = grasp_object.inertia
    body.explicitinertial = True
    body.mass = grasp_object.mass_kg
    body.ipos = grasp_object.centroid
    body.fullinertia = (*np.diag(moments), moments[0, 1], moments[0, 2], moments[1, 2])
    for k, piece in enumerate(grasp_object.pieces):
        # Its own priority makes the object's friction and softness hold in all its contacts.
        geom = body.add_geom(
            name=f"piece{k}",
            contype=_OBJECT_BIT,
            conaffinity=0,
            priority=1,
            condim=settings.condim,
            friction=(grasp_object.friction, settings.torsion_m, 1e-4),
            solref=settings.solref,
            solimp=(*settings.solimp, 0.5, 2),
            rgba=(0.90, 0.62, 0.25, 1.0),
        )
        if isinstance(piece, ConvexPiece):
            mesh = spec.add_mesh(name=f"piece{k}", uservert=piece.vertices.ravel().tolist())
            # Only the shape counts here: the body's inertia is given above.
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, mesh.name
        else:
            geom.type = getattr(mujoco.mjtGeom, "mjGEOM_" + piece.kind.upper())
            geom.size[: len(piece.size)] = piece.size
            geom.pos = piece.obj_T_geom[:3, 3]
            geom.quat = quaternion(piece.obj_T_geom[:3, :3])


def _add_arm_and_hand(spec: Any, gripper: Gripper, settings: TrialSettings) -> None:
    lift = spec.worldbody.add_body(name="lift")
    mount = lift.add_body(name="mount")
    slides = {lift: ("lift", (0.0, 0.0, 1.0)), mount: ("approach", gripper.base_T_tcp[:3, 2])}
    for body, (name, axis) in slides.items():
        body.explicitinertial, body.mass, body.inertia = True, 1e-3, (1e-6, 1e-6, 1e-6)
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, armature=_ARM_KG)
        # A velocity command, integrated to a set point: smooth motion from piecewise commands.
        servo = spec.add_actuator(
            name=name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target=name,
            forcelimited=name == "approach",
            forcerange=(-settings.arm_force_n, settings.arm_force_n),
        )
        servo.set_to_intvelocity(kp=_ARM_STIFFNESS, kv=_ARM_DAMPING)
        servo.actlimited = True
        servo.actrange = (-10.0, 0.0) if name == "approach" else (0.0, settings.lift_height_m)
    hand = gripper.spec()
    for key in list(hand.keys):
        hand.delete(key)
    feels = _OBJECT_BIT | (_TABLE_BIT if settings.hand_touches_table else 0)
    for geom in hand.geoms:
        if geom.contype or geom.conaffinity:
            geom.contype = _HAND_BIT if gripper.self_collision else 0
            geom.conaffinity = feels | (_HAND_BIT if gripper.self_collision else 0)
            geom.condim, geom.priority = 1, 0
            geom.solref, geom.solimp = settings.solref, (*settings.solimp, 0.5, 2)
    mount.add_frame().attach_body(hand.worldbody.first_body(), "hand/", "")


def _radius(grasp_object: GraspObject) -> float:
    """Of the collision pieces about the centroid, in any rotation."""
    radii = []
    for piece in grasp_object.pieces:
        if isinstance(piece, ConvexPiece):
            points = piece.vertices
        else:
            size = piece.size
            half = {"box": size, "cylinder": (size[0], size[0], size[-1]), "sphere": 3 * size[:1]}
            corners = np.array(np.meshgrid(*[(-h, h) for h in half[piece.kind]])).reshape(3, -1).T
            points = corners @ piece.obj_T_geom[:3, :3].T + piece.obj_T_geom[:3, 3]
        radii.append(np.linalg.norm(points - grasp_object.centroid, axis=1).max())
    return float(max(radii))


def _reach(model: Any, base: int, of_hand: ndarray) -> float:
    """A bound on how far any part of the hand can be from its base, whatever its joints do."""
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
    """Fill in the state in which every trial starts: open hand and object, both at rest."""
    model, data = scene.model, scene.data
    scene.rest_qpos[:] = model.qpos0
    reference = grasp_object.sim_T_ref
    scene.rest_qpos[scene.object_qpos] = (*reference[:3, 3], *quaternion(reference[:3, :3]))
    scene.park()
    for name, value in gripper.closing.open.items():
        data.ctrl[scene.hand_ctrl[name]] = value
    mujoco.mj_step(model, data, nstep=round(_REST_S / model.opt.timestep))
    if scene.exploded():
        raise MismatchError(
            f"{grasp_object.name!r} at rest and the open gripper {gripper.name!r}, far from each "
            f"other, blow up within {_REST_S:g} s: look at the gripper's servos (more damping "
            "and armature, less stiffness) and at the object's inertia"
        )
    placed = np.eye(4)
    placed[:3, 3] = data.qpos[scene.object_qpos][:3]
    placed[:3, :3] = rotation_from_quaternion(data.qpos[scene.object_qpos][3:])
    ref_T_placed = invert(reference) @ placed
    shift = float(np.linalg.norm(placed[:3, 3] - reference[:3, 3]))
    turn = float(np.arccos(np.clip(0.5 * (np.trace(ref_T_placed[:3, :3]) - 1.0), -1.0, 1.0)))
    if not (shift <= _REST_SHIFT_M and turn <= _REST_TURN_RAD):
        raise MismatchError(
            f"object {grasp_object.name!r} does not rest in its reference pose: left alone, it "
            f"moves by {1e3 * shift:.1f} mm and {np.degrees(turn):.1f} degrees in {_REST_S:g} s; "
            "give a pose in which it stands on the plane z = 0"
        )
    scene.rest_qpos[:] = data.qpos
    scene.rest_act[:] = data.act
    for index in (scene.approach_qpos, scene.lift_qpos):
        scene.rest_qpos[index] = 0.0
    for name in ("lift", "approach"):
        scene.rest_act[model.actuator_actadr[model.actuator(name).id]] = 0.0
