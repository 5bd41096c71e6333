"""MuJoCo specification of a trial's scene: table, object, arm and hand.

The arm has two stiff slides: ``lift`` moves along the world's z; on it ``approach``, limited in
force, moves along the hand's approach direction. The body ``mount`` between the two has the pose of
the grasp. The hand keeps its orientation and does not move sideways: this is the rigid, open-loop
control of the paper's Section III-B.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from graspcast.pose.transforms import quaternion
from graspcast.simulation.engine import jacobian, mujoco
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.types import ConvexPiece, GraspObject
from graspcast.simulation.trial.settings import TrialSettings

__all__ = ["ARM_STIFFNESS", "scene_spec", "set_solver"]

ARM_STIFFNESS = 1e5
"""Stiffness of the arm's two servos, N/m."""

# Bits of contype. A contact needs one geom's contype in the other's conaffinity.
_OBJECT_BIT, _TABLE_BIT, _HAND_BIT = 1, 2, 4
_ARM_KG = 10.0
_ARM_DAMPING = 2.0 * np.sqrt(ARM_STIFFNESS * _ARM_KG)


def scene_spec(grasp_object: GraspObject, gripper: Gripper, settings: TrialSettings) -> Any:
    """Return an ``MjSpec`` with the bodies object, lift, mount, and the hand's as ``hand/...``."""
    spec = mujoco.MjSpec()
    _set_options(spec, settings)
    spec.worldbody.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(0, 0, 0.05),
        condim=1,
        contype=_TABLE_BIT,
        conaffinity=_OBJECT_BIT,
        solref=settings.solref,
        solimp=(*settings.solimp, 0.5, 2),
        rgba=(0.93, 0.92, 0.90, 1.0),
    )
    _add_object(spec, grasp_object, settings)
    _add_arm_and_hand(spec, gripper, settings)
    return spec


def set_solver(option: Any, solver: tuple[float, str]) -> None:
    """Set the tolerance of the constraint solver, and how it stores Jacobians."""
    tolerance, storage = solver
    option.tolerance = tolerance
    option.jacobian = jacobian(storage)


def _set_options(spec: Any, settings: TrialSettings) -> None:
    option = spec.option
    option.timestep = settings.timestep
    option.integrator = getattr(mujoco.mjtIntegrator, "mjINT_" + settings.integrator.upper())
    option.cone = getattr(mujoco.mjtCone, "mjCONE_" + settings.cone.upper())
    option.impratio = settings.impratio
    option.noslip_iterations = settings.noslip_iterations
    option.iterations = settings.iterations
    set_solver(option, settings.solver)
    # An unstable state must be detected, not reset silently.
    option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    # With so few bodies, finding islands takes longer than it saves.
    option.disableflags |= int(getattr(mujoco.mjtDisableBit, "mjDSBL_ISLAND", 0))


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
        # With priority 1 the object's friction and softness apply in all its contacts.
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
            # The body's inertia is given above; the mesh only needs a valid one.
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
        servo.set_to_intvelocity(kp=ARM_STIFFNESS, kv=_ARM_DAMPING)
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
