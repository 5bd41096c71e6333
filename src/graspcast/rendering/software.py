"""Rendering of MuJoCo scenes in software, without OpenGL."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray

from graspcast.pose.transforms import invert, transform, transform_points
from graspcast.rendering.rasterizer import Canvas, Lighting, corner_normals

__all__ = ["SoftwareDrawer"]

_TILE, _TILE_LINE = (0.97, 0.97, 0.97), (0.66, 0.67, 0.68)
_SPACING_M, _LINE_M = 0.1, 0.0008  # distance of the table's lines, half their width
_FARTHEST = 1e-3
"""One over the depth at which the table ends."""
_Z_OFFSET = 2e-4
_STEEP = 0.1
"""Sine of the elevation below which light casts no shadow on the table."""


@dataclass(frozen=True, eq=False)
class _Shape:
    """A mesh in its own frame, metres, with normals of its triangles' corners."""

    vertices: Float[ndarray, "v 3"]
    faces: Int[ndarray, "f 3"]
    normals: Float[ndarray, "f 3 3"]


class SoftwareDrawer:
    """A :class:`graspcast.rendering.backend.Drawer` that runs on the CPU.

    It draws meshes, boxes, spheres, ellipsoids, capsules and cylinders; planes are drawn as a table
    with a grid. Shadows fall only on the table; there are no specular highlights and no textures.
    """

    def __init__(self, model: Any, width: int, height: int):
        self._model, self.width, self.height = model, width, height
        self._meshes: dict[int, _Shape] = {}

    def draw(self, scene: Any) -> UInt8[ndarray, "h w 3"]:
        """Render an ``MjvScene`` that has been updated."""
        from graspcast.simulation.engine import mujoco

        cam_T_sim, K = self._camera(scene)
        canvas = Canvas(K, self.width, self.height)
        rotation = cam_T_sim[:3, :3]
        lighting = _lighting(scene, rotation)
        geoms = [scene.geoms[k] for k in range(scene.ngeom)]
        solids = [
            (geom, cam_T_sim @ transform(geom.mat, geom.pos), shape)
            for geom in geoms
            if geom.rgba[3] > 0 and (shape := self._shape(geom)) is not None
        ]
        for geom in geoms:
            if geom.type == mujoco.mjtGeom.mjGEOM_PLANE:
                cam_T_plane = cam_T_sim @ transform(geom.mat, geom.pos)
                casting = [
                    transform_points(cam_T_geom, shape.vertices)[shape.faces]
                    for other, cam_T_geom, shape in solids
                    if other.rgba[3] == 1
                ]
                shadows = [
                    (number, _shadow(canvas, cam_T_plane, casting, lighting.directions[number]))
                    for number in range(scene.nlight)
                    if scene.lights[number].castshadow
                ]
                _draw_table(canvas, cam_T_plane, lighting, float(geom.emission), shadows)
        for number, (geom, cam_T_geom, shape) in enumerate(solids):
            # Two links share the sphere of their joint. Scaling every other geom slightly along
            # the viewing rays, which changes nothing in the image, avoids z-fighting.
            scale = 1 + _Z_OFFSET * (number % 2)
            canvas.draw(
                scale * transform_points(cam_T_geom, shape.vertices),
                shape.faces,
                (float(geom.rgba[0]), float(geom.rgba[1]), float(geom.rgba[2])),
                # OpenGL blends the back faces too.
                alpha=1.0 - (1.0 - float(geom.rgba[3])) ** 2,
                lighting=lighting,
                normals=shape.normals @ cam_T_geom[:3, :3].T,
            )
        return canvas.image()

    def close(self) -> None:
        """Do nothing: there are no resources to free."""

    def _camera(self, scene: Any) -> tuple[Float[ndarray, "4 4"], Float[ndarray, "3 3"]]:
        """Return ``cam_T_sim`` and K, for the centre between the scene's two eyes."""
        left, right = scene.camera
        forward, up = np.array(left.forward, np.float64), np.array(left.up, np.float64)
        axes = np.stack([np.cross(forward, up), -up, forward], axis=1)
        middle = (np.array(left.pos, np.float64) + np.array(right.pos, np.float64)) / 2
        focal = self.height * left.frustum_near / (left.frustum_top - left.frustum_bottom)
        K = np.array([[focal, 0, self.width / 2], [0, focal, self.height / 2], [0, 0, 1.0]])
        K[:2, 2] -= 0.5
        return invert(transform(axes, middle)), K

    def _shape(self, geom: Any) -> _Shape | None:
        from trimesh import creation

        from graspcast.simulation.engine import mujoco

        kind, types = geom.type, mujoco.mjtGeom
        size = np.array(geom.size, np.float64)
        if kind == types.mjGEOM_MESH:
            # An odd number means the mesh's convex hull.
            number = int(geom.dataid) // 2
            if number not in self._meshes:
                self._meshes[number] = self._mesh(number)
            return self._meshes[number]
        if kind == types.mjGEOM_BOX:
            made = creation.box(extents=2 * size)
            vertices = np.array(made.vertices)
        elif kind in (types.mjGEOM_SPHERE, types.mjGEOM_ELLIPSOID):
            made = creation.icosphere(subdivisions=3)
            vertices = made.vertices * size
        elif kind == types.mjGEOM_CYLINDER:
            made = creation.cylinder(radius=1.0, height=2.0, sections=48)
            vertices = made.vertices * size
        elif kind == types.mjGEOM_CAPSULE:
            made = creation.uv_sphere(radius=1.0, count=(32, 48))
            ends = np.where(made.vertices[:, 2:] > 0, size[2], -size[2])
            vertices = made.vertices * size[0] + ends * [0.0, 0.0, 1.0]
        else:
            return None
        faces = np.array(made.faces)
        return _Shape(vertices, faces, corner_normals(vertices, faces))

    def _mesh(self, number: int) -> _Shape:
        model = self._model
        first, count = model.mesh_vertadr[number], model.mesh_vertnum[number]
        vertices = model.mesh_vert[first : first + count].astype(np.float64)
        first, count = model.mesh_faceadr[number], model.mesh_facenum[number]
        faces = model.mesh_face[first : first + count].astype(np.int64)
        return _Shape(vertices, faces, corner_normals(vertices, faces))


def _lighting(scene: Any, rotation: Float[ndarray, "3 3"]) -> Lighting:
    """Convert a scene's lights to grey directional lights in the camera's frame."""
    lights = [scene.lights[k] for k in range(scene.nlight)]
    return Lighting(
        float(sum(np.mean(light.ambient) for light in lights)),
        np.array([light.dir for light in lights], np.float64).reshape(-1, 3) @ rotation.T,
        np.array([np.mean(light.diffuse) for light in lights], np.float64),
    )


def _shadow(
    canvas: Canvas,
    cam_T_plane: Float[ndarray, "4 4"],
    casting: list[ndarray],
    direction: Float[ndarray, " 3"],
) -> Bool[ndarray, "hs ws"]:
    """Return the mask of the shadow that triangles, (f, 3, 3) each, cast on a plane."""
    normal, origin = cam_T_plane[:3, 2], cam_T_plane[:3, 3]
    out = np.zeros(canvas.inverse_depth.shape, dtype=bool)
    falling = float(direction @ normal)
    if falling > -_STEEP:
        return out
    for corners in casting:
        height = (corners - origin) @ normal
        if height.max() > 0:
            flat = corners - (height / falling)[..., None] * direction
            out |= canvas.silhouette(flat.reshape(-1, 3), np.arange(flat.size // 3).reshape(-1, 3))
    return out


def _draw_table(
    canvas: Canvas,
    cam_T_plane: Float[ndarray, "4 4"],
    lighting: Lighting,
    emission: float,
    shadows: list[tuple[int, Bool[ndarray, "hs ws"]]],
) -> None:
    """Draw a white plane with grid lines every 100 mm behind everything drawn before.

    Lines are anti-aliased by the area of the plane that a pixel covers, so that far ones fade.
    """
    normal, origin = cam_T_plane[:3, 2], cam_T_plane[:3, 3]
    inverse_depth = canvas.rays() @ (normal / (origin @ normal))
    seen = inverse_depth > np.maximum(canvas.inverse_depth, _FARTHEST)
    pixels = Canvas(canvas.K, canvas.width, canvas.height, supersample=1).rays()
    depth = 1 / np.maximum(pixels @ (normal / (origin @ normal)), _FARTHEST)
    x, y = np.moveaxis((pixels * depth[..., None] - origin) @ cam_T_plane[:3, :2], -1, 0)
    steps = [np.abs(step) for at in (x, y) for step in np.gradient(at)]
    width = np.maximum.reduce([np.full_like(x, 1e-6), *steps])
    line = np.maximum(_line(x, width), _line(y, width))[..., None]
    s = canvas.supersample
    tile = ((1 - line) * _TILE + line * _TILE_LINE).repeat(s, axis=0).repeat(s, axis=1)
    light = np.full(seen.shape, emission + lighting.on(normal))
    for number, dark in shadows:
        light[dark] -= lighting.strengths[number] * max(0.0, -lighting.directions[number] @ normal)
    canvas.colour[seen] = np.minimum(tile[seen] * light[seen, None], 1.0)
    canvas.inverse_depth[seen] = inverse_depth[seen]


def _line(at: Float[ndarray, "h w"], width: Float[ndarray, "h w"]) -> Float[ndarray, "h w"]:
    """Compute the fraction of an interval, metres, that the nearest grid line covers."""
    off = np.abs((at / _SPACING_M + 0.5) % 1 - 0.5) * _SPACING_M
    inside = np.minimum(off + width / 2, _LINE_M) - np.maximum(off - width / 2, -_LINE_M)
    return np.maximum(inside, 0.0) / width
