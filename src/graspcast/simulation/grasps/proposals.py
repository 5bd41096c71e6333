"""Grasp proposals from an object's shape in its reference pose.

A proposal samples the direction of approach (from above, level, or oblique), the closing direction,
the position across the object and the depth. The fingers must be able to span the object there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.pose.transforms import compose, exp, invert, transform
from graspcast.simulation.grasps.antipodal import points_on_faces
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.types import GraspObject
from graspcast.simulation.trial.scene import HAND, Scene

__all__ = ["OpenHand", "propose", "surface_points", "vary"]

_KINDS = {"top": 0.4, "level": 0.4, "oblique": 0.2}
_MARGIN_M = 0.001


def surface_points(
    grasp_object: GraspObject, count: int, rng: np.random.Generator
) -> Float[ndarray, "p 3"]:
    """Sample points on the mesh uniformly by area, in the object's frame, metres."""
    return points_on_faces(grasp_object, count, rng)[0]


@dataclass(frozen=True, eq=False)
class OpenHand:
    """Bounding boxes of the colliding parts of an open hand, in the TCP's frame.

    Attributes
    ----------
    tcp_T_box
        Poses of the boxes, (g, 4, 4).
    half
        Half sizes of the boxes, metres, (g, 3).
    opening_m
        Distance between the open fingers, metres.
    """

    tcp_T_box: Float[ndarray, "g 4 4"]
    half: Float[ndarray, "g 3"]
    opening_m: float

    @classmethod
    def of(cls, scene: Scene, gripper: Gripper) -> OpenHand:
        """Compute the boxes from a compiled scene, whose hand is reset to rest."""
        scene.park()
        model, data = scene.model, scene.data
        sim_T_base = transform(data.xmat[scene.base_body].reshape(3, 3), data.xpos[scene.base_body])
        tcp_T_sim = invert(compose(sim_T_base, gripper.base_T_tcp))
        geoms = np.flatnonzero(scene.kind == HAND)
        rotation = data.geom_xmat[geoms].reshape(-1, 3, 3)
        middle = np.einsum("gij,gj->gi", rotation, model.geom_aabb[geoms, :3])
        sim_T_box = transform(rotation, data.geom_xpos[geoms] + middle)
        return cls(compose(tcp_T_sim, sim_T_box), model.geom_aabb[geoms, 3:], gripper.max_opening_m)

    @property
    def reach_m(self) -> float:
        """Distance of the TCP from the palm, along the approach, metres."""
        behind = []
        for tcp_T_box, half in zip(self.tcp_T_box, self.half, strict=True):
            middle, size = tcp_T_box[:3, 3], np.abs(tcp_T_box[:3, :3]) @ half
            if np.all(np.abs(middle[:2]) <= size[:2]):
                behind.append(-(middle[2] + size[2]))
        return max(0.01, min(behind, default=0.05))

    @property
    def tip_m(self) -> float:
        """How far the fingertips reach beyond the TCP, along the approach, metres."""
        along = np.einsum("gj,gj->g", np.abs(self.tcp_T_box[:, 2, :3]), self.half)
        return float((self.tcp_T_box[:, 2, 3] + along).max())

    def predict(
        self,
        obj_T_grasp: Float[ndarray, "4 4"],
        est_T_points: Float[ndarray, "n p 3"],
        penetration_m: float,
    ) -> Bool[ndarray, " n"]:
        """Predict from geometry whether a grasp succeeds.

        The hand must not penetrate the object, and part of the object must be between the fingers.

        Parameters
        ----------
        obj_T_grasp
            The grasp.
        est_T_points
            Points of the object in the frame of each estimate, metres.
        penetration_m
            Largest allowed penetration of a point into the hand, metres.
        """
        grasp_T_obj = invert(obj_T_grasp)
        points = est_T_points @ grasp_T_obj[:3, :3].T + grasp_T_obj[:3, 3]
        inside = np.zeros(points.shape[:2], dtype=bool)
        for box_T_tcp, half in zip(invert(self.tcp_T_box), self.half, strict=True):
            local = np.abs(points @ box_T_tcp[:3, :3].T + box_T_tcp[:3, 3])
            inside |= np.all(local < half - min(penetration_m, 0.9 * half.min()), axis=2)
        region = (0.5 * self.opening_m, 0.010, 0.2 * self.reach_m + 0.004)
        between = np.all(np.abs(points) < region, axis=2)
        return ~inside.any(axis=1) & between.any(axis=1)


def propose(
    grasp_object: GraspObject,
    hand: OpenHand,
    count: int,
    rng: np.random.Generator,
    points: Float[ndarray, "p 3"],
) -> Float[ndarray, "k 4 4"]:
    """Propose up to ``count`` grasps (``obj_T_grasp``); fewer if few directions fit the hand.

    Parameters
    ----------
    grasp_object
        The object.
    hand
        The open hand.
    count
        Largest number of grasps.
    rng
        Random generator.
    points
        Points on the surface, in the object's frame, metres.
    """
    sim_T_obj = grasp_object.sim_T_ref
    cloud = points @ sim_T_obj[:3, :3].T + sim_T_obj[:3, 3]
    found: list[ndarray] = []
    for _ in range(20 * count):
        sim_T_grasp = _aim(cloud, hand, _direction(rng), rng)
        if sim_T_grasp is not None:
            found.append(invert(sim_T_obj) @ sim_T_grasp)
        if len(found) == count:
            break
    return np.array(found).reshape(-1, 4, 4)


def _direction(rng: np.random.Generator) -> Float[ndarray, "3 3"]:
    """Sample the axes of the grasp's frame in the world: closing, sideways, approach (columns)."""
    kind = str(rng.choice(list(_KINDS), p=list(_KINDS.values())))
    azimuth = rng.integers(8) * (np.pi / 4)
    if kind == "top":
        approach = np.array([0.0, 0.0, -1.0])
        closing = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    else:
        down = 0.0 if kind == "level" else rng.choice([np.pi / 6, np.pi / 4, np.pi / 3])
        level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        approach = np.cos(down) * level - np.sin(down) * np.array([0.0, 0.0, 1.0])
        closing = np.cross(approach, [0.0, 0.0, 1.0]) * rng.choice([-1.0, 1.0])
        if rng.random() < 0.2:
            closing = np.cross(approach, closing)
        closing /= np.linalg.norm(closing)
    return np.stack([closing, np.cross(approach, closing), approach], axis=1)


def _aim(
    cloud: Float[ndarray, "p 3"],
    hand: OpenHand,
    axes: Float[ndarray, "3 3"],
    rng: np.random.Generator,
) -> Float[ndarray, "4 4"] | None:
    """Sample the TCP's pose for a direction; None if the object is too wide there."""
    local = cloud @ axes
    low, high = local.min(axis=0), local.max(axis=0)
    aside = 0.0 if rng.random() < 0.4 else rng.uniform(-0.7, 0.7)
    y = 0.5 * (low[1] + high[1]) + aside * 0.5 * (high[1] - low[1])
    strip = local[np.abs(local[:, 1] - y) < 0.012]
    if len(strip) < 5:
        return None
    z = np.quantile(strip[:, 2], 0.02) + rng.uniform(0.15, 1.0) * hand.reach_m
    grasped = strip[strip[:, 2] < z + 0.01]
    if len(grasped) < 5:
        return None
    left, right = grasped[:, 0].min(), grasped[:, 0].max()
    if right - left > hand.opening_m - 2 * _MARGIN_M:
        return None
    x = 0.5 * (left + right)
    if rng.random() < 0.5:
        x += rng.uniform(-0.15, 0.15) * min(0.06, hand.opening_m)
    return transform(axes, axes @ np.array([x, y, z]))


def vary(
    obj_T_grasp: Float[ndarray, "4 4"],
    translation_m: float,
    rotation_rad: float,
    rng: np.random.Generator,
) -> Float[ndarray, "4 4"]:
    """Return the grasp with normal noise in its own frame, on position and rotation vector."""
    noise = rng.standard_normal(6) * ([translation_m] * 3 + [rotation_rad] * 3)
    shift, turn = np.eye(4), np.concatenate([np.zeros(3), noise[3:]])
    shift[:3, 3] = noise[:3]
    return compose(obj_T_grasp, shift, exp(turn))
