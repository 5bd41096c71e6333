"""Visual model of a scene: the object's mesh, the estimate, the hand and lights; no physics."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.pose.transforms import quaternion
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.mujoco_messages import compile_spec
from graspcast.simulation.objects.types import ConvexPiece, GraspObject, box_corners
from graspcast.simulation.trial.recording import State

__all__ = ["FOVY_DEG", "Appearance"]

FOVY_DEG = 25.0
"""Vertical field of view of the camera, degrees."""

_OBJECT, _ESTIMATE = (0.93, 0.60, 0.20, 1.0), (0.10, 0.78, 0.25, 0.40)
_WHITE, _LINE = (0.97, 0.97, 0.97), (0.66, 0.67, 0.68)
_AWAY = np.eye(4)
_AWAY[2, 3] = -100.0


class Appearance:
    """Visual model of a scene, in which the poses of object, estimate and hand are set directly.

    Parameters
    ----------
    grasp_object
        The object; if it has no mesh, its collision pieces are shown.
    gripper
        The gripper.
    collision
        Show the collision pieces in place of the mesh.
    width, height
        Size of the largest off-screen picture, pixels.

    Attributes
    ----------
    model, data
        MuJoCo's model and state, for a renderer or viewer.
    object_corners
        Corners of boxes about the object, in its frame, metres.
    """

    def __init__(
        self,
        grasp_object: GraspObject,
        gripper: Gripper,
        *,
        collision: bool = False,
        width: int = 640,
        height: int = 480,
    ):
        from graspcast.simulation.engine import mujoco

        self.model = _model(grasp_object, gripper, width, height, collision)
        self.data = mujoco.MjData(self.model)
        self._mocap = {
            name: int(self.model.body_mocapid[self.model.body(name).id])
            for name in ("object", "estimate", "hand")
        }
        mujoco.mj_kinematics(self.model, self.data)
        self.object_corners: Float[ndarray, "n 3"] = self._boxes("object")

    def pose(self, state: State, sim_T_est: Float[ndarray, "4 4"] | None = None) -> None:
        """Set the model to a state, and show the estimate if one is given."""
        from graspcast.simulation.engine import mujoco

        for name, pose in (
            ("object", state.sim_T_obj),
            ("hand", state.sim_T_base),
            ("estimate", _AWAY if sim_T_est is None else sim_T_est),
        ):
            self.data.mocap_pos[self._mocap[name]] = pose[:3, 3]
            self.data.mocap_quat[self._mocap[name]] = quaternion(pose[:3, :3])
        self.data.qpos[:] = state.hand_joints
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        mujoco.mj_tendon(self.model, self.data)

    def hand_corners(self, state: State) -> Float[ndarray, "n 3"]:
        """Return corners of boxes about the hand's parts in a state, in the world frame, metres."""
        self.pose(state)
        return self._boxes("hand")

    def _boxes(self, name: str) -> Float[ndarray, "n 3"]:
        """Return corners of the boxes about the geoms of a mocap body and its descendants."""
        root = self.model.body(name).id
        geoms = np.flatnonzero(self.model.body_rootid[self.model.geom_bodyid] == root)
        box = self.model.geom_aabb[geoms]
        local = box[:, None, :3] + box_corners(box[:, 3:])
        rotation = self.data.geom_xmat[geoms].reshape(-1, 3, 3)
        world = np.einsum("gij,gkj->gki", rotation, local)
        world += self.data.geom_xpos[geoms][:, None]
        return world.reshape(-1, 3)


def _model(
    grasp_object: GraspObject, gripper: Gripper, width: int, height: int, collision: bool
) -> Any:
    """Return the compiled model; object, estimate and hand are mocap bodies."""
    from graspcast.simulation.engine import mujoco

    spec = mujoco.MjSpec()
    _add_surroundings(spec, width, height)
    for name, rgba in (("object", _OBJECT), ("estimate", _ESTIMATE)):
        material = spec.add_material(name=name, rgba=rgba, specular=0.25, shininess=0.4)
        body = spec.worldbody.add_body(name=name, mocap=True)
        _add_shape(spec, body, grasp_object, material.name, collision)
    hand = gripper.spec()
    for key in list(hand.keys):
        hand.delete(key)
    for light in list(hand.lights):
        hand.delete(light)
    carrier = spec.worldbody.add_body(name="hand", mocap=True)
    carrier.add_frame().attach_body(hand.worldbody.first_body(), "hand/", "")
    model = compile_spec(spec, f"the picture of {grasp_object.name!r} and {gripper.name!r}")
    base = int(np.flatnonzero(model.body_parentid == model.body("hand").id)[0])
    model.body_pos[base], model.body_quat[base] = 0.0, (1.0, 0.0, 0.0, 0.0)
    return model


def _add_surroundings(spec: Any, width: int, height: int) -> None:
    """Add the camera's settings, sky, table and lights."""
    from graspcast.simulation.engine import mujoco

    visual = spec.visual
    visual.global_.fovy = FOVY_DEG
    visual.global_.offwidth, visual.global_.offheight = width, height
    visual.quality.offsamples, visual.quality.shadowsize = 4, 4096
    visual.headlight.ambient, visual.headlight.diffuse = 3 * (0.45,), 3 * (0.22,)
    visual.headlight.specular = 3 * (0.05,)
    visual.rgba.haze = (1, 1, 1, 1)
    visual.map.znear, visual.map.zfar, visual.map.shadowclip = 0.05, 60.0, 6.0
    spec.stat.extent, spec.stat.center = 0.5, (0, 0, 0.1)
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=(1, 1, 1),
        rgb2=(1, 1, 1),
        width=16,
        height=16,
    )
    spec.add_texture(
        name="grid",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        mark=mujoco.mjtMark.mjMARK_EDGE,
        rgb1=_WHITE,
        rgb2=_WHITE,
        markrgb=_LINE,
        width=128,
        height=128,
    )
    # Lines every 100 mm: on a plane MuJoCo repeats a texture half as often as specified.
    table = spec.add_material(
        name="table", texrepeat=(20, 20), texuniform=True, specular=0, emission=0.12
    )
    table.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grid"
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 0.05), material="table", name="table"
    )
    lights = (((-0.2, -0.3, 1.0), 0.36, True), ((0.9, -0.3, 0.6), 0.2, False))
    for position, strength, shadow in lights:
        spec.worldbody.add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            pos=position,
            dir=tuple(-x for x in position),
            diffuse=3 * (strength,),
            specular=3 * (0.1,),
            castshadow=shadow,
        )


def _add_shape(
    spec: Any, body: Any, grasp_object: GraspObject, material: str, collision: bool
) -> None:
    """Add the object's mesh, or its collision pieces if requested or if there is no mesh."""
    from graspcast.simulation.engine import mujoco

    look = {"material": material, "contype": 0, "conaffinity": 0}

    def add_mesh(name: str, vertices: ndarray, faces: ndarray) -> None:
        mesh = spec.add_mesh(name=name, uservert=vertices.ravel().tolist())
        if len(faces):
            mesh.userface = faces.ravel().tolist()
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **look)

    if len(grasp_object.faces) and not collision:
        add_mesh(body.name, grasp_object.vertices, grasp_object.faces)
        return
    for k, piece in enumerate(grasp_object.pieces):
        if isinstance(piece, ConvexPiece):
            add_mesh(f"{body.name}{k}", piece.vertices, piece.faces)
            continue
        size = np.zeros(3)
        size[: len(piece.size)] = piece.size
        body.add_geom(
            type=getattr(mujoco.mjtGeom, "mjGEOM_" + piece.kind.upper()),
            size=size,
            pos=piece.obj_T_geom[:3, 3],
            quat=quaternion(piece.obj_T_geom[:3, :3]),
            **look,
        )
