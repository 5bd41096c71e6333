"""Rendering of a tabletop: colour, depth and instance masks for any pinhole camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray

from graspcast.pose.transforms import invert
from graspcast.rendering.opengl import OpenGLDrawer
from graspcast.rendering.synthetic.camera import View
from graspcast.rendering.synthetic.tabletop import Tabletop

__all__ = ["Frame", "Renderer"]

_NEAR, _FAR = 0.05, 20.0


@dataclass(frozen=True, eq=False)
class Frame:
    """A rendered image and its ground truth.

    Attributes
    ----------
    rgb
        The image.
    depth_m
        Depth along the optical axis, metres.
    label
        Index in ``Tabletop.obj_ids`` of the object at each pixel, -1 for none.
    cam_T_obj
        Pose of each object, in the order of ``Tabletop.obj_ids``.
    """

    rgb: UInt8[ndarray, "h w 3"]
    depth_m: Float[ndarray, "h w"]
    label: Int[ndarray, "h w"]
    cam_T_obj: Float[ndarray, "n 4 4"]


class Renderer:
    """A renderer of a tabletop. Use it in one thread, and as a context manager.

    Parameters
    ----------
    tabletop
        The scene; it must allow for images of twice this width and height, since silhouettes
        extend beyond the image's border.
    K
        Intrinsics in pixels; the centre of the first pixel is (0, 0).
    width, height
        Size of the image, pixels.

    Raises
    ------
    ExtraMissingError
        If PyOpenGL is not installed.
    InputError
        If OpenGL does not work.
    """

    def __init__(
        self, tabletop: Tabletop, K: Float[ndarray, "3 3"], *, width: int = 640, height: int = 480
    ):
        from graspcast.simulation.engine import mujoco

        self.tabletop, self.K, self.width, self.height = tabletop, K, width, height
        self._drawer = OpenGLDrawer(tabletop.model, 2 * width, 2 * height)
        self._scene = mujoco.MjvScene(tabletop.model, maxgeom=200)

    def new_layout(self) -> None:
        """Update the textures after :meth:`Tabletop.lay_out`."""
        for texture in self.tabletop.surfaces:
            self._drawer.upload(texture)

    def frame(self, view: View) -> Frame:
        """Render the image and its ground truth for a view."""
        self._set_lights(view)
        self._set_camera(view, self.K, self.width, self.height, range(6))
        rgb, depth = self._drawer.draw_with_depth(self._scene, self.width, self.height)
        rgb[depth == 1.0] = view.light.sky
        label = self._labels(self.width, self.height)
        cam_T_obj = invert(view.sim_T_cam) @ self.tabletop.poses()
        return Frame(rgb, _metric(depth), label, cam_T_obj)

    def silhouette(self, view: View, index: int) -> Bool[ndarray, "h2 w2"]:
        """Render the silhouette of an object without occlusion.

        The mask extends beyond the image by half its width and height on each side.
        """
        geoms = self.tabletop.model.geom_group
        K = self.K + np.array([[0, 0, self.width / 2], [0, 0, self.height / 2], [0, 0, 0]])
        geoms[:], geoms[self.tabletop.geoms[index]] = 1, 0
        try:
            self._set_camera(view, K, 2 * self.width, 2 * self.height, (0,))
            return self._labels(2 * self.width, 2 * self.height) == index
        finally:
            geoms[:] = 0

    def close(self) -> None:
        """Free the OpenGL resources."""
        self._drawer.close()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _set_lights(self, view: View) -> None:
        model, light = self.tabletop.model, view.light
        model.vis.headlight.ambient[:] = light.ambient
        model.vis.headlight.diffuse[:] = model.vis.headlight.specular[:] = 0.0
        model.light_diffuse[:] = light.strengths
        model.light_specular[:] = 0.5 * light.strengths
        model.light_ambient[:] = 0.0
        self.tabletop.data.light_xdir[:] = light.directions

    def _set_camera(
        self, view: View, K: Float[ndarray, "3 3"], width: int, height: int, groups: Any
    ) -> None:
        from graspcast.simulation.engine import mujoco

        option = mujoco.MjvOption()
        option.geomgroup[:] = [group in groups for group in range(6)]
        mujoco.mjv_updateScene(
            self.tabletop.model, self.tabletop.data, option, None, mujoco.MjvCamera(),
            mujoco.mjtCatBit.mjCAT_ALL, self._scene,
        )  # fmt: skip
        # The image's border is half a pixel beyond the centre of its first pixel.
        left, right = (np.array([-0.5, width - 0.5]) - K[0, 2]) / K[0, 0] * _NEAR
        top, bottom = (K[1, 2] - np.array([-0.5, height - 0.5])) / K[1, 1] * _NEAR
        for camera in self._scene.camera:
            camera.pos[:] = view.sim_T_cam[:3, 3]
            camera.forward[:], camera.up[:] = view.sim_T_cam[:3, 2], -view.sim_T_cam[:3, 1]
            camera.frustum_center, camera.frustum_width = (left + right) / 2, (right - left) / 2
            camera.frustum_top, camera.frustum_bottom = top, bottom
            camera.frustum_near, camera.frustum_far = _NEAR, _FAR

    def _labels(self, width: int, height: int) -> Int[ndarray, "h w"]:
        from graspcast.simulation.engine import mujoco

        scene, flags = self._scene, self._scene.flags
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
        rgb, _ = self._drawer.draw_with_depth(self._scene, width, height)
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 0
        number = rgb[..., 0].astype(np.int64)  # fewer than 255 geoms: the first byte is enough
        index_of = {int(geom): k for k, geom in enumerate(self.tabletop.geoms)}
        table = np.full(256, -1)
        for k in range(scene.ngeom):
            geom = scene.geoms[k]
            if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                table[geom.segid + 1] = index_of.get(int(geom.objid), -1)
        return table[number]


def _metric(depth: ndarray) -> Float[ndarray, "h w"]:
    """Convert a depth buffer in [0, 1] to metres along the optical axis."""
    z: ndarray = _NEAR / (1.0 - depth.astype(np.float64) * (1.0 - _NEAR / _FAR))
    return z
