"""Off-screen renderer of trials: the object, the hand, and the estimate as a green overlay."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.pose.transforms import transform_points
from graspcast.rendering.backend import Drawer, open_drawer
from graspcast.rendering.trials.appearance import FOVY_DEG, Appearance
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.types import GraspObject
from graspcast.simulation.trial.recording import Recording, State

__all__ = ["SceneRenderer", "View"]

_MARGIN = 1.06


@dataclass(frozen=True, eq=False)
class View:
    """Viewpoint of a picture: the point looked at, the direction, and the distance (m)."""

    lookat: Float[ndarray, " 3"]
    distance: float
    azimuth_deg: float
    elevation_deg: float

    def axes(self) -> Float[ndarray, "3 3"]:
        """Return the directions to the right, up and forward, as rows."""
        a, e = np.radians([self.azimuth_deg, self.elevation_deg])
        forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        right = np.array([np.sin(a), -np.cos(a), 0.0])
        return np.stack([right, np.cross(right, forward), forward])

    def pixels(
        self, points: Float[ndarray, "n 3"], width: int, height: int
    ) -> Float[ndarray, "n 2"]:
        """Return where points of the world lie in a picture, pixels from its upper left corner."""
        seen = (points - self.lookat) @ self.axes().T + [0.0, 0.0, self.distance]
        focal = 0.5 * height / np.tan(np.radians(FOVY_DEG) / 2)
        offset: ndarray = focal * seen[:, :2] / seen[:, 2:] * [1.0, -1.0]
        return offset + [0.5 * width, 0.5 * height]


class SceneRenderer:
    """Renderer of the states of trials of one object with one gripper.

    Uses OpenGL, or a software renderer if OpenGL is not available
    (:func:`graspcast.rendering.backend.why_software`). Use it as a context manager, and in one
    thread only.

    Parameters
    ----------
    grasp_object
        The object; if it has no mesh, its collision pieces are drawn.
    gripper
        The gripper.
    width, height
        Size of the pictures, pixels.
    collision
        Draw the collision pieces instead of the mesh.

    Raises
    ------
    InputError
        If ``MUJOCO_GL`` does not name an OpenGL backend.
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
        self._drawer: Drawer | None = None
        from graspcast.simulation.engine import mujoco

        self.width, self.height = width, height
        self.gripper = gripper
        self._seen = Appearance(
            grasp_object, gripper, collision=collision, width=width, height=height
        )
        self._scene = mujoco.MjvScene(self._seen.model, maxgeom=2000)
        self._drawer = open_drawer(self._seen.model, width, height)

    def image(
        self, state: State, view: View, sim_T_est: Float[ndarray, "4 4"] | None = None
    ) -> UInt8[ndarray, "h w 3"]:
        """Draw a state, with the estimate as an overlay if one is given."""
        from graspcast.simulation.engine import mujoco

        if self._drawer is None:
            raise ValueError("this renderer is closed")
        seen = self._seen
        seen.pose(state, sim_T_est)
        camera = mujoco.MjvCamera()
        camera.lookat[:], camera.distance = view.lookat, view.distance
        camera.azimuth, camera.elevation = view.azimuth_deg, view.elevation_deg
        option = mujoco.MjvOption()
        mujoco.mjv_updateScene(
            seen.model, seen.data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, self._scene
        )
        return self._drawer.draw(self._scene)

    def views(self, recording: Recording) -> list[View]:
        """Return a view for each state: fixed until the lift, then following the hand.

        If the object stays behind, the view contains both.
        """
        azimuth, elevation = _direction(
            recording.states[0].sim_T_base[:3, :3] @ self.gripper.base_T_tcp[:3, :3]
        )
        still = [s for s in recording.states if s.phase != "lift"]
        ends = (still[0], still[-1])
        hand = [self._seen.hand_corners(state) for state in ends]
        things = [transform_points(state.sim_T_obj, self._seen.object_corners) for state in ends]
        things.append(transform_points(recording.sim_T_est, self._seen.object_corners))
        points = np.concatenate(hand + things)
        lowest = still[-1].sim_T_base[2, 3]
        out = []
        for state in recording.states:
            seen = points
            if state.phase == "lift":
                risen = points + [0.0, 0.0, state.sim_T_base[2, 3] - lowest]
                seen = np.concatenate(
                    [risen, transform_points(state.sim_T_obj, self._seen.object_corners)]
                )
            out.append(self._frame(seen, azimuth, elevation))
        return out

    def close_up(self, state: State) -> View:
        """Return a view of the object in the hand."""
        azimuth, elevation = _direction(state.sim_T_base[:3, :3] @ self.gripper.base_T_tcp[:3, :3])
        points = [
            self._seen.hand_corners(state),
            transform_points(state.sim_T_obj, self._seen.object_corners),
        ]
        return self._frame(np.concatenate(points), azimuth, elevation)

    def hand_from(self, state: State, azimuth_deg: float, also: Float[ndarray, "n 3"]) -> View:
        """Return a level view of the hand and some points, without the object."""
        points = np.concatenate([self._seen.hand_corners(state), also])
        return self._frame(points, azimuth_deg, 0.0)

    def close(self) -> None:
        """Free the resources of the graphics card; may be called twice."""
        if self._drawer is not None:
            self._drawer.close()
        self._drawer = None

    def __enter__(self) -> SceneRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _frame(self, points: Float[ndarray, "n 3"], azimuth: float, elevation: float) -> View:
        """Return the nearest view from a direction that contains all points."""
        axes = View(np.zeros(3), 0.0, azimuth, elevation).axes()
        seen = points @ axes.T
        middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
        off = seen - middle
        half = np.tan(np.radians(FOVY_DEG) / 2) / _MARGIN
        limits = np.array([half * self.width / self.height, half])
        distance = (np.abs(off[:, :2]) / limits).max(axis=1) - off[:, 2]
        return View(axes.T @ middle, float(distance.max()), azimuth, elevation)


def _direction(sim_T_tcp: Float[ndarray, "3 3"]) -> tuple[float, float]:
    """Return azimuth and elevation (degrees) of a view that shows both closing and approach.

    The view is nearly along y of the tool centre point's frame if that is level, else across the
    approach; slightly from the side and from above.
    """
    _, across, approach = sim_T_tcp.T
    level = across if np.hypot(*across[:2]) > 0.5 else np.array([-approach[1], approach[0], 0.0])
    azimuth = np.degrees(np.arctan2(level[1], level[0]))
    # Of the two sides, the one closer to looking along the world's +y.
    if np.cos(np.radians(azimuth - 90.0)) < 0:
        azimuth += 180.0
    steep = abs(across[2]) > 0.5
    return float(azimuth + 28.0), -32.0 if steep else -16.0
