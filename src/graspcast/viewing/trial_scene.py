"""A trial as a scene: table, object, estimate and hand, and how they moved."""

from __future__ import annotations

import numpy as np

from graspcast.rendering.trials.bodies import Body, TrialBodies
from graspcast.rendering.trials.film import describe
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.types import GraspObject
from graspcast.simulation.trial.recording import Recording
from graspcast.viewing.scene import Motion, Node, Scene, Shape

__all__ = ["trial_scene"]

_STEP_S = 1 / 25
_TABLE_M, _TABLE, _ESTIMATE = 0.6, (225, 226, 228), (26, 199, 64)
_OBJECT = (237, 153, 51)


def trial_scene(
    recording: Recording,
    grasp_object: GraspObject,
    gripper: Gripper,
    title: str,
    *,
    collision: bool = False,
) -> Scene:
    """Return a recorded trial as a scene whose motion is the trial, 25 states a second.

    Parameters
    ----------
    recording
        The trial.
    grasp_object, gripper
        What was grasped, by what.
    title
        What the scene is called; the outcome is added.
    collision
        Show the collision pieces of the object, not its mesh.
    """
    seen = TrialBodies(grasp_object, gripper, collision=collision)
    states = recording.every(_STEP_S)
    # The last state but one may be of the same time.
    times = np.array([state.time_s - states[0].time_s for state in states])
    kept = [i for i in range(len(states)) if i == len(states) - 1 or times[i] < times[i + 1]]
    poses = [seen.poses(states[i]) for i in kept]
    moving = {name: np.stack([pose[name] for pose in poses]) for name in seen.bodies}
    del moving["estimate"]  # it stays where it is
    nodes = [_table()]
    about = {"outcome": describe(recording.outcome), "success": bool(recording.outcome.success)}
    for name in moving:
        more = about if name == "object" else {}
        nodes.append(Node(name, _shape(seen.bodies[name]), moving[name][0], more))
    if recording.overlay(recording.states[0]) is not None:
        body = seen.bodies["estimate"]
        shape = Shape(body.vertices, body.faces, np.array(_ESTIMATE, dtype=np.uint8), 0.4)
        nodes.append(Node("estimate", shape, recording.sim_T_est))
    motion = Motion(times[kept], moving, tuple(states[i].phase for i in kept))
    return Scene(
        f"{title} gripper: {describe(recording.outcome)}",
        tuple(nodes),
        "z",
        "the simulator's: the table is the plane z = 0",
        (("object", _OBJECT), ("estimate that guides the grasp", _ESTIMATE)),
        motion,
    )


def _shape(body: Body) -> Shape:
    return Shape(
        body.vertices,
        body.faces,
        np.ascontiguousarray(body.colours[:, :3]),
        float(body.colours[:, 3].min()) / 255,
    )


def _table() -> Node:
    half = _TABLE_M / 2
    # A little lower than the table, so that what stands on it is seen.
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    pose = np.eye(4)
    pose[2, 3] = -5e-4
    return Node("table", Shape(corners, faces, np.array(_TABLE, dtype=np.uint8)), pose)
