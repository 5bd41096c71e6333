"""Physics simulation of objects and clutter that come to rest on a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.pose.transforms import (
    quaternion,
    rotation_from_quaternion,
    rotation_from_vector,
    transform,
)
from graspcast.rendering.synthetic.textures import bake, random_surface

__all__ = ["ColouredMesh", "Tabletop"]

CLUTTER = 6
"""Number of plain boxes, cylinders and spheres."""
_KINDS = ("BOX", "CYLINDER", "SPHERE")
_SURFACE = 256
_RADIUS_M = 0.16
_REACH_M = 0.40
_SECONDS, _STEP = 1.6, 0.004
_TRIES = 20
_MOST = 8
"""Largest number of objects on the table."""
_SPEED, _SPIN = 0.05, 1.0
_AWAY_M = 1000.0


@dataclass(frozen=True, eq=False)
class ColouredMesh:
    """A mesh (metres, object frame) with a colour for each vertex."""

    vertices: Float[ndarray, "v 3"]
    faces: Int[ndarray, "f 3"]
    colours: UInt8[ndarray, "v 3"]


class Tabletop:
    """Objects, clutter and a table in one MuJoCo model, which can be rearranged repeatedly.

    Parameters
    ----------
    meshes
        Objects by BOP id.
    width, height
        Size of the largest image to be rendered, pixels.

    Attributes
    ----------
    model, data
        MuJoCo's model and data.
    obj_ids
        BOP ids of the objects, in the order of their bodies.
    geoms
        MuJoCo ids of the objects' geoms.
    surfaces
        MuJoCo ids of the textures of the table and of the clutter.
    present
        Which objects are on the table, (n,).
    """

    def __init__(self, meshes: Mapping[int, ColouredMesh], *, width: int, height: int):
        from graspcast.simulation.engine import avoid_wrong_factors, mujoco

        if not meshes:
            raise InputError("there are no objects")
        self.obj_ids = tuple(meshes)
        spec = _spec(meshes, width, height)
        try:
            self.model = avoid_wrong_factors(spec.compile())
        except ValueError as error:
            first = str(error).splitlines()[0]
            raise InputError(
                f"objects {', '.join(map(str, meshes))}: MuJoCo rejects a mesh ({first}); are "
                "all meshes solid, and in millimetres?"
            ) from error
        # Damping, so that objects stop rolling before they leave the table.
        self.model.dof_damping[:] = np.tile(3 * [0.2] + 3 * [5e-4], self.model.njnt)
        self.data = mujoco.MjData(self.model)
        self.geoms = np.array([self.model.geom(f"obj{k}").id for k in self.obj_ids])
        # MuJoCo moves a mesh's frame to its centre of mass; poses refer to the file's frame.
        self._geom_T_obj = [
            np.linalg.inv(
                transform(rotation_from_quaternion(self.model.mesh_quat[m]), self.model.mesh_pos[m])
            )
            for m in self.model.geom_dataid[self.geoms]
        ]
        self.surfaces = [self.model.texture(name).id for name in ("table", "clutter")]
        self.present = np.ones(len(self.obj_ids), dtype=bool)
        self._clutter = np.array([self.model.geom(f"clutter{k}").id for k in range(CLUTTER)])

    def lay_out(self, rng: np.random.Generator) -> None:
        """Drop objects and clutter on the table until they rest, and randomise the surfaces.

        Raises
        ------
        InputError
            If they do not come to rest.
        """
        self._randomise_surfaces(rng)
        for _ in range(_TRIES):
            if self._drop(rng):
                return
        raise InputError(
            f"objects {', '.join(map(str, self.obj_ids))} did not come to rest on the table in "
            f"{_TRIES} tries; are their meshes in millimetres?"
        )

    def poses(self) -> Float[ndarray, "n 4 4"]:
        """Return ``sim_T_obj`` of every object, (n, 4, 4)."""
        rotation = self.data.geom_xmat[self.geoms].reshape(-1, 3, 3)
        sim_T_geom = transform(rotation, self.data.geom_xpos[self.geoms])
        return np.array([a @ b for a, b in zip(sim_T_geom, self._geom_T_obj, strict=True)])

    def _randomise_surfaces(self, rng: np.random.Generator) -> None:
        model = self.model
        for texture in self.surfaces:
            start = model.tex_adr[texture]
            model.tex_data[start : start + 3 * _SURFACE**2] = random_surface(rng, _SURFACE).ravel()
        model.mat_texrepeat[model.material("table").id] = rng.uniform(0.5, 4.0)
        for geom in self._clutter:
            size = rng.uniform(0.015, 0.05, 3)
            model.geom_size[geom] = size
            model.geom_rbound[geom] = np.linalg.norm(size)
            model.geom_aabb[geom, 3:] = size
            if model.geom_type[geom] == _type("CYLINDER"):
                model.geom_aabb[geom, 3:] = size[[0, 0, 1]]
            elif model.geom_type[geom] == _type("SPHERE"):
                model.geom_aabb[geom, 3:] = size[0]
            model.geom_rgba[geom, :3] = rng.uniform(0.1, 1.0, 3)
        for geom in self.geoms:
            material = model.geom_matid[geom]
            model.mat_specular[material] = rng.uniform(0.0, 0.5)
            model.mat_shininess[material] = rng.uniform(0.1, 0.9)

    def _drop(self, rng: np.random.Generator) -> bool:
        from graspcast.simulation.engine import mujoco

        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        count = len(self.obj_ids)
        self.present = np.ones(count, dtype=bool)
        self.present[rng.permutation(count)[_MOST:]] = False
        there = np.concatenate([self.present, rng.random(CLUTTER) < 0.5])
        # Stacked in a random order, so that nothing overlaps at the start.
        height = 0.03
        for body in rng.permutation(len(there)).tolist():
            where = slice(7 * body, 7 * body + 7)
            if not there[body]:
                data.qpos[where] = [5.0 + body, 5.0, 0.5, 1, 0, 0, 0]
                continue
            geom = self.geoms[body] if body < count else self._clutter[body - count]
            reach = float(np.linalg.norm(model.geom_aabb[geom, 3:]))
            radius, angle = _RADIUS_M * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
            height += 0.5 * reach
            data.qpos[where] = [
                radius * np.cos(angle), radius * np.sin(angle), height + 0.5 * reach,
                *_orientation(rng, self._upright(body)),
            ]  # fmt: skip
            height += 0.5 * reach
        mujoco.mj_step(model, data, nstep=round(_SECONDS / _STEP))
        there[:count] &= self._stays()
        self.present = there[:count]
        # Absent bodies are moved out of sight.
        data.qpos.reshape(-1, 7)[~there, 2] = _AWAY_M
        mujoco.mj_forward(model, data)
        velocity = np.abs(data.qvel.reshape(-1, 6)[:count][self.present])
        return bool(
            2 * self.present.sum() > min(count, _MOST)
            and (velocity[:, :3] < _SPEED).all()
            and (velocity[:, 3:] < _SPIN).all()
        )

    def _stays(self) -> Bool[ndarray, " n"]:
        """Return which objects rest on the table, near its centre."""
        place = self.data.qpos.reshape(-1, 7)[: len(self.obj_ids), :3]
        near = np.hypot(place[:, 0], place[:, 1]) < _REACH_M
        return np.asarray(near & (place[:, 2] > 0.0))

    def _upright(self, body: int) -> Float[ndarray, "3 3"]:
        """Return the rotation of a body in which its object stands upright."""
        if body >= len(self.obj_ids):
            return np.eye(3)
        return self._geom_T_obj[body][:3, :3].T


def _type(kind: str) -> int:
    from graspcast.simulation.engine import mujoco

    return int(getattr(mujoco.mjtGeom, f"mjGEOM_{kind}"))


def _orientation(rng: np.random.Generator, upright: Float[ndarray, "3 3"]) -> ndarray:
    """Sample an orientation: half of the time nearly upright, otherwise uniform."""
    if rng.random() < 0.5:
        turn = rotation_from_vector(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
        tilt = rotation_from_vector(rng.normal(0, 0.1, 3))
        return quaternion(tilt @ turn @ upright)
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def _spec(meshes: Mapping[int, ColouredMesh], width: int, height: int) -> Any:
    from graspcast.simulation.engine import mujoco

    spec = mujoco.MjSpec()
    spec.option.timestep = _STEP
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    # Neither shadows nor multisampling: eighty times as fast without a graphics card.
    spec.visual.quality.offsamples = 0
    spec.visual.map.znear, spec.visual.map.zfar = 0.05, 20.0
    spec.stat.extent = 1.0
    for name in ("table", "clutter"):
        _add_texture(spec, name, np.zeros((_SURFACE, _SURFACE, 3), dtype=np.uint8))
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 0.05), material="table", name="table"
    )
    spec.material("table").texuniform = True
    for k in range(3):
        spec.worldbody.add_light(
            name=f"light{k}", type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, castshadow=False
        )
    touch = {"condim": 6, "friction": (0.8, 0.01, 0.003), "density": 400.0}
    for obj_id, mesh in meshes.items():
        atlas = bake(mesh.vertices, mesh.faces, mesh.colours)
        name = f"obj{obj_id}"
        _add_texture(spec, name, atlas.pixels)
        shape = spec.add_mesh(name=name, uservert=mesh.vertices.ravel().tolist())
        shape.userface = mesh.faces.ravel().tolist()
        shape.usertexcoord = atlas.corners.ravel().tolist()
        shape.userfacetexcoord = list(range(3 * len(mesh.faces)))
        # A scan may be an open surface, which has no volume.
        shape.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        body = spec.worldbody.add_body(name=name)
        body.add_freejoint()
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=name, name=name, **touch
        )
    for k in range(CLUTTER):
        body = spec.worldbody.add_body(name=f"clutter{k}")
        body.add_freejoint()
        body.add_geom(
            type=getattr(mujoco.mjtGeom, f"mjGEOM_{_KINDS[k % 3]}"), size=(0.04, 0.04, 0.04),
            material="clutter", name=f"clutter{k}", rgba=(0.6, 0.5, 0.4, 1), **touch,
        )  # fmt: skip
    return spec


def _add_texture(spec: Any, name: str, pixels: UInt8[ndarray, "h w 3"]) -> None:
    """Add a texture and a material of that name."""
    from graspcast.simulation.engine import mujoco

    texture = spec.add_texture(
        name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, nchannel=3,
        width=pixels.shape[1], height=pixels.shape[0],
    )  # fmt: skip
    texture.data = pixels.tobytes()
    material = spec.add_material(name=name)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
