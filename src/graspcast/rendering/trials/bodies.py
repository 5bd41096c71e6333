"""Bodies of a trial as meshes, for other programs to draw: object, hand, and where they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray

from graspcast.pose.transforms import rotation_from_quaternion, transform, transform_points
from graspcast.rendering.trials.appearance import Appearance
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.types import GraspObject
from graspcast.simulation.trial.gripper_bench import standing_column
from graspcast.simulation.trial.recording import State
from graspcast.simulation.trial.trial import TrialRunner

__all__ = ["Body", "TrialBodies", "open_hand", "rest_joints"]

_DRAWN_GROUPS = 3
"""MuJoCo draws the groups below this one; others are shapes of collision."""


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body as a mesh.

    Attributes
    ----------
    name
        ``object``, or ``hand/`` and the name of a part of the hand.
    vertices, faces
        The mesh in the body's frame, metres.
    colours
        RGB and opacity of each vertex.
    """

    name: str
    vertices: Float[ndarray, "v 3"]
    faces: Int[ndarray, "f 3"]
    colours: UInt8[ndarray, "v 4"]


class TrialBodies:
    """The bodies of a trial that are drawn, and their poses in its states.

    Parameters
    ----------
    grasp_object, gripper
        The object and the gripper.
    collision
        The object's collision pieces instead of its mesh.

    Attributes
    ----------
    bodies
        The bodies, by name: ``object``, ``estimate`` and parts of the hand.
    """

    def __init__(self, grasp_object: GraspObject, gripper: Gripper, *, collision: bool = False):
        self._seen = Appearance(grasp_object, gripper, collision=collision)
        self.bodies: dict[str, Body] = {}
        self._numbers: dict[str, int] = {}
        model = self._seen.model
        for number in range(1, model.nbody):
            name = model.body(number).name or f"hand/part {number}"
            if body := _body(model, number, name):
                self.bodies[name], self._numbers[name] = body, number

    def poses(self, state: State) -> dict[str, Float[ndarray, "4 4"]]:
        """Return the pose of each body in a state, in the simulator's frame, by name."""
        self._seen.pose(state)
        data = self._seen.data
        return {
            name: transform(data.xmat[number].reshape(3, 3), data.xpos[number].copy())
            for name, number in self._numbers.items()
        }


def rest_joints(runner: TrialRunner) -> Float[ndarray, " j"]:
    """Return the joint positions of the open hand."""
    scene = runner.scene
    joints: ndarray = scene.rest_qpos[scene.model.jnt_qposadr[scene.hand_joints]]
    return joints.copy()


def open_hand(gripper: Gripper) -> Body:
    """Return the open hand as one mesh, in the frame of its base, metres."""
    column = standing_column(0.5 * gripper.max_opening_m)
    joints = rest_joints(TrialRunner(column, gripper))
    bodies = TrialBodies(column, gripper)
    poses = bodies.poses(State("approach", 0.0, np.eye(4), np.eye(4), joints))
    parts = [body for name, body in bodies.bodies.items() if name.startswith("hand/")]
    return _joined(gripper.name, [(part, poses[part.name]) for part in parts])


def _joined(name: str, parts: list[tuple[Body, ndarray]]) -> Body:
    """Return several bodies, each at its pose, as one."""
    starts = np.cumsum([0, *(len(body.vertices) for body, _ in parts)])
    return Body(
        name,
        np.concatenate([transform_points(pose, body.vertices) for body, pose in parts]),
        np.concatenate([body.faces + k for (body, _), k in zip(parts, starts, strict=False)]),
        np.concatenate([body.colours for body, _ in parts]),
    )


def _body(model: Any, number: int, name: str) -> Body | None:
    """Return the drawn geoms of a body as one mesh in the body's frame; None if there is none."""
    parts = []
    for geom in np.flatnonzero(model.geom_bodyid == number).tolist():
        material = int(model.geom_matid[geom])
        rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
        shape = _shape(model, geom) if model.geom_group[geom] < _DRAWN_GROUPS else None
        if shape is None or rgba[3] == 0:
            continue
        vertices, faces = shape
        colours = np.tile(np.round(255 * rgba).astype(np.uint8), (len(vertices), 1))
        pose = transform(
            rotation_from_quaternion(model.geom_quat[geom].copy()), model.geom_pos[geom].copy()
        )
        parts.append((Body(name, vertices, faces, colours), pose))
    return _joined(name, parts) if parts else None


def _shape(model: Any, geom: int) -> tuple[ndarray, ndarray] | None:
    """Return the mesh of a geom in its own frame; None for one without an end, such as a plane."""
    from trimesh import creation

    from graspcast.simulation.engine import mujoco

    kinds, size = mujoco.mjtGeom, model.geom_size[geom]
    kind = model.geom_type[geom]
    if kind == kinds.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        start, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        vertices = model.mesh_vert[first : first + count].astype(np.float64)
        return vertices, model.mesh_face[start : start + faces].astype(np.int64)
    if kind == kinds.mjGEOM_BOX:
        made = creation.box(extents=2 * size)
        made.unmerge_vertices()  # its edges are sharp
    elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
        made = creation.icosphere(subdivisions=3, radius=1.0)
        made.apply_scale(size if kind == kinds.mjGEOM_ELLIPSOID else 3 * (size[0],))
    elif kind == kinds.mjGEOM_CYLINDER:
        made = creation.cylinder(radius=size[0], height=2 * size[1])
    elif kind == kinds.mjGEOM_CAPSULE:
        made = creation.capsule(radius=size[0], height=2 * size[1])
        made.apply_translation(-made.bounds.mean(axis=0))
    else:
        return None
    return np.array(made.vertices), np.array(made.faces)
