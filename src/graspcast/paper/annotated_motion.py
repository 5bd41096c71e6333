"""Camera motion of static scenes from the annotated poses of their objects.

YCB-V's annotation is one camera track a scene: the poses of all objects give the same motion.
LM-O's objects were rearranged between the images, so that there is no such motion.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.pose.transforms import compose, invert

__all__ = ["camera_track"]

_SAME_M = 0.001
"""Farther apart than this, two objects give different motions: the scene is not static."""


def camera_track(
    annotated: Mapping[int, Mapping[int, Float[ndarray, "4 4"]]],
) -> dict[int, Float[ndarray, "4 4"]] | None:
    """Return the camera's pose in each image of a scene, in the frame of the first image's camera.

    Parameters
    ----------
    annotated
        Image to object to its annotated ``cam_T_obj``, metres. An object is in an image once.

    Returns
    -------
    Image to ``world_T_cam``, without images that share no object with the others; or None if
    objects were moved between the images, so that there is no such motion.
    """
    waiting = {im_id: poses for im_id, poses in sorted(annotated.items()) if poses}
    world_T_cam: dict[int, ndarray] = {}
    world_T_obj: dict[int, ndarray] = {}
    while waiting:
        im_id = next((i for i, poses in waiting.items() if world_T_obj.keys() & poses), None)
        if im_id is None and world_T_cam:
            break
        im_id = min(waiting) if im_id is None else im_id
        poses = waiting.pop(im_id)
        shared = sorted(world_T_obj.keys() & poses)
        found = [compose(world_T_obj[o], invert(poses[o])) for o in shared]
        world_T_cam[im_id] = found[0] if found else np.eye(4)
        for obj_id, cam_T_obj in poses.items():
            here = compose(world_T_cam[im_id], cam_T_obj)
            before = world_T_obj.setdefault(obj_id, here)
            if np.linalg.norm(before[:3, 3] - here[:3, 3]) > _SAME_M:
                return None
    return world_T_cam
