"""Pictures of a scene without a display: the object, the estimate as a green overlay, the hand."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.errors import ExtraMissingError, InputError
from graspcast.geometry import quaternion, transform_points
from graspcast.grasping.gripper import Gripper
from graspcast.grasping.recording import Recording, State
from graspcast.grasping.types import ConvexPiece, GraspObject

__all__ = ["SceneRenderer", "View", "choose_gl"]

_OBJECT, _ESTIMATE = (0.93, 0.60, 0.20, 1.0), (0.10, 0.78, 0.25, 0.40)
_WHITE, _LINE = (0.97, 0.97, 0.965), (0.80, 0.81, 0.82)
_FOVY_DEG = 25.0
_MARGIN = 1.06
_SAME_M = 5e-4
"""An estimate that puts no point of the object farther off than this is not drawn over it."""

_BACKENDS = ("egl", "osmesa", "glfw")


def choose_gl() -> str:
    """Have MuJoCo draw without a display, unless the user has set ``MUJOCO_GL``.

    Call it before ``mujoco`` is imported: it refuses to be imported with a value it does not know.

    Returns:
        The backend on Linux, ``""`` elsewhere, where MuJoCo has its own.

    Raises:
        InputError: for a value of ``MUJOCO_GL`` that no picture can be drawn with.
    """
    if platform.system() != "Linux":
        return ""
    name = os.environ.get("MUJOCO_GL", "").strip().lower()
    if not name:
        name = os.environ["MUJOCO_GL"] = "egl"
    if name not in _BACKENDS:
        raise InputError(
            f"the environment variable MUJOCO_GL is {name!r}, with which no picture can be drawn; "
            f"unset it, or set it to one of {', '.join(_BACKENDS)}"
        )
    return name


def _gl_context(width: int, height: int) -> Any:
    """An OpenGL context that is current.

    The backend is imported here, whatever MuJoCo has chosen when it was imported, which may have
    been before :func:`choose_gl`.
    """
    name = choose_gl()
    try:
        if name == "egl":
            from mujoco.egl import GLContext
        elif name == "osmesa":
            from mujoco.osmesa import GLContext
        elif name == "glfw":
            from mujoco.glfw import GLContext
        else:
            from mujoco.rendering.classic.gl_context import GLContext
        context = GLContext(width, height)
        context.make_current()
    except Exception as error:  # each backend and driver fails in its own way
        package = getattr(error, "name", None) or ""
        if isinstance(error, ModuleNotFoundError) and package.split(".")[0] in ("OpenGL", "glfw"):
            raise ExtraMissingError("glfw" if package == "glfw" else "pyopengl", "render") from error
        other = "osmesa" if name == "egl" else "egl"
        remedy = (
            f"install the system's EGL (Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri) or "
            f"OSMesa (apt install libosmesa6), or try MUJOCO_GL={other}"
            if name
            else "is there a graphics driver?"
        )
        raise InputError(
            f"cannot draw: OpenGL{' by ' + name.upper() if name else ''} does not work here "
            f"({type(error).__name__}: {error}); {remedy}"
        ) from error
    return context


@dataclass(frozen=True, eq=False)
class View:
    """Where a picture is taken from: looking at a point, from a direction, at a distance (m)."""

    lookat: Float[ndarray, " 3"]
    distance: float
    azimuth_deg: float
    elevation_deg: float


class SceneRenderer:
    """Draws states of trials of one object with one gripper.

    Its model holds what is to be seen and no physics: the object's mesh in place of its collision
    pieces, the estimate, the hand, light. Use it in one thread, and as a context manager.

    Args:
        grasp_object: The object; without a mesh its collision pieces are drawn.
        gripper: The gripper.
        width, height: Pixels.
        collision: Draw the collision pieces in place of the mesh.

    Raises:
        ExtraMissingError: if PyOpenGL is not installed.
        InputError: if there is no OpenGL to draw with.
    """

    def __init__(
        self,
        grasp_object: GraspObject,
        gripper: Gripper,
        *,
        width: int = 640,
        height: int = 480,
        collision: bool = False,
    ):
        self._context = self._mjr = None
        choose_gl()
        import mujoco

        self.width, self.height = width, height
        self.grasp_object, self.gripper = grasp_object, gripper
        self.model = _model(grasp_object, gripper, width, height, collision)
        self.data = mujoco.MjData(self.model)
        self._mocap = {
            name: int(self.model.body_mocapid[self.model.body(name).id])
            for name in ("object", "estimate", "hand")
        }
        mujoco.mj_kinematics(self.model, self.data)
        self._corners = self._boxes("object")
        self._context = _gl_context(width, height)
        self._scene = mujoco.MjvScene(self.model, maxgeom=2000)
        self._mjr = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._mjr)

    def image(
        self, state: State, view: View, sim_T_est: Float[ndarray, "4 4"] | None = None
    ) -> UInt8[ndarray, "h w 3"]:
        """A picture of a state; with the estimate laid over it where one is given."""
        import mujoco

        if self._mjr is None:
            raise ValueError("this renderer is closed")
        self.pose(state, sim_T_est)
        camera = mujoco.MjvCamera()
        camera.lookat[:], camera.distance = view.lookat, view.distance
        camera.azimuth, camera.elevation = view.azimuth_deg, view.elevation_deg
        option = mujoco.MjvOption()
        mujoco.mjv_updateScene(
            self.model, self.data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, self._scene
        )
        self._context.make_current()
        area = mujoco.MjrRect(0, 0, self.width, self.height)
        mujoco.mjr_render(area, self._scene, self._mjr)
        pixels = np.empty((self.height, self.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, area, self._mjr)
        return pixels[::-1].copy()

    def pose(self, state: State, sim_T_est: Float[ndarray, "4 4"] | None = None) -> None:
        """Bring the model into a state, for :meth:`image` or MuJoCo's viewer."""
        import mujoco

        away = np.eye(4)
        away[2, 3] = -100.0
        if sim_T_est is not None:
            apart = transform_points(sim_T_est, self._corners) - transform_points(
                state.sim_T_obj, self._corners
            )
            # Two surfaces in one place flicker.
            if np.linalg.norm(apart, axis=1).max() < _SAME_M:
                sim_T_est = None
        for name, pose in (
            ("object", state.sim_T_obj),
            ("hand", state.sim_T_base),
            ("estimate", away if sim_T_est is None else sim_T_est),
        ):
            self.data.mocap_pos[self._mocap[name]] = pose[:3, 3]
            self.data.mocap_quat[self._mocap[name]] = quaternion(pose[:3, :3])
        self.data.qpos[:] = state.hand_joints
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        mujoco.mj_tendon(self.model, self.data)

    def views(self, recording: Recording) -> list[View]:
        """One view for each state: still until the lift, then it follows the hand.

        Where the object stays behind, both are kept in the picture.
        """
        azimuth, elevation = _direction(
            recording.states[0].sim_T_base[:3, :3] @ self.gripper.base_T_tcp[:3, :3]
        )
        still = [s for s in recording.states if s.phase != "lift"]
        ends = (still[0], still[-1])
        hand = [self._hand_points(state) for state in ends]
        things = [transform_points(state.sim_T_obj, self._corners) for state in ends]
        things.append(transform_points(recording.sim_T_est, self._corners))
        points = np.concatenate(hand + things)
        lowest = still[-1].sim_T_base[2, 3]
        out = []
        for state in recording.states:
            seen = points
            if state.phase == "lift":
                risen = points + [0.0, 0.0, state.sim_T_base[2, 3] - lowest]
                seen = np.concatenate(
                    [risen, transform_points(state.sim_T_obj, self._corners)]
                )
            out.append(self._frame(seen, azimuth, elevation))
        return out

    def close_up(self, state: State) -> View:
        """A view of the object in the hand."""
        azimuth, elevation = _direction(state.sim_T_base[:3, :3] @ self.gripper.base_T_tcp[:3, :3])
        points = [self._hand_points(state), transform_points(state.sim_T_obj, self._corners)]
        return self._frame(np.concatenate(points), azimuth, elevation)

    def close(self) -> None:
        """Free what is held on the graphics card."""
        if self._mjr is not None:
            self._context.make_current()
            self._mjr.free()
            self._context.free()
        self._context = self._mjr = None

    def __enter__(self) -> SceneRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _hand_points(self, state: State) -> Float[ndarray, "n 3"]:
        self.pose(state)
        return self._boxes("hand")

    def _boxes(self, name: str) -> Float[ndarray, "n 3"]:
        """Corners of the boxes about the geoms of a mocap body and all that hangs on it."""
        root = self.model.body(name).id
        geoms = np.flatnonzero(self.model.body_rootid[self.model.geom_bodyid] == root)
        box = self.model.geom_aabb[geoms]
        signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(-1, 3)
        local = box[:, None, :3] + signs * box[:, None, 3:]
        rotation = self.data.geom_xmat[geoms].reshape(-1, 3, 3)
        world = np.einsum("gij,gkj->gki", rotation, local)
        world += self.data.geom_xpos[geoms][:, None]
        return world.reshape(-1, 3)

    def _frame(self, points: Float[ndarray, "n 3"], azimuth: float, elevation: float) -> View:
        """The nearest view from a direction that has all points in the picture."""
        a, e = np.radians([azimuth, elevation])
        forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        right = np.array([np.sin(a), -np.cos(a), 0.0])
        axes = np.stack([right, np.cross(right, forward), forward])
        seen = points @ axes.T
        middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
        off = seen - middle
        half = np.tan(np.radians(_FOVY_DEG) / 2) / _MARGIN
        limits = np.array([half * self.width / self.height, half])
        distance = (np.abs(off[:, :2]) / limits).max(axis=1) - off[:, 2]
        return View(axes.T @ middle, float(distance.max()), azimuth, elevation)


def _direction(sim_T_tcp: Float[ndarray, "3 3"]) -> tuple[float, float]:
    """Azimuth and elevation (degrees) from which the closing and the approach are both seen.

    Nearly along y of the tool centre point's frame where that is level, else across the approach;
    a little from the side and from above.
    """
    closing, across, approach = sim_T_tcp.T
    level = across if np.hypot(*across[:2]) > 0.5 else np.array([-approach[1], approach[0], 0.0])
    azimuth = np.degrees(np.arctan2(level[1], level[0]))
    # Of the two sides, the one nearer to looking along the world's +y.
    if np.cos(np.radians(azimuth - 90.0)) < 0:
        azimuth += 180.0
    steep = abs(across[2]) > 0.5
    return float(azimuth + 28.0), -32.0 if steep else -16.0


def _model(
    grasp_object: GraspObject, gripper: Gripper, width: int, height: int, collision: bool
) -> Any:
    """What is to be seen; every movable thing is a mocap body, so that poses are simply set."""
    import mujoco

    spec = mujoco.MjSpec()
    visual = spec.visual
    visual.global_.fovy = _FOVY_DEG
    visual.global_.offwidth, visual.global_.offheight = width, height
    visual.quality.offsamples, visual.quality.shadowsize = 4, 2048
    visual.headlight.ambient, visual.headlight.diffuse = 3 * (0.45,), 3 * (0.22,)
    visual.headlight.specular = 3 * (0.05,)
    visual.rgba.haze = (1, 1, 1, 1)
    visual.map.znear, visual.map.zfar, visual.map.shadowclip = 0.05, 60.0, 2.5
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
        width=256,
        height=256,
    )
    # Lines every 100 mm.
    table = spec.add_material(name="table", texrepeat=(10, 10), texuniform=True, specular=0.0)
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
    model = spec.compile()
    base = int(np.flatnonzero(model.body_parentid == model.body("hand").id)[0])
    model.body_pos[base], model.body_quat[base] = 0.0, (1.0, 0.0, 0.0, 0.0)
    return model


def _add_shape(
    spec: Any, body: Any, grasp_object: GraspObject, material: str, collision: bool
) -> None:
    """The object's mesh, or its collision pieces where those are wanted or all there is."""
    import mujoco

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
