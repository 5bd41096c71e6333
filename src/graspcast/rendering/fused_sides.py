"""Estimates from two images and the pose fused from all views, drawn on both images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from graspcast.bop.dataset import BopDataset
from graspcast.bop.meshes import read_coloured_mesh
from graspcast.bop.results import Results
from graspcast.errors import InputError
from graspcast.pose.transforms import compose
from graspcast.rendering.two_sides import DrawnPose, Side, two_sides
from graspcast.views.camera_motion import CameraMotion
from graspcast.views.camera_tables import read_camera_motion
from graspcast.views.fused_estimates import FusedEstimates, fuse_estimates

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["draw_fused"]

_ORANGE, _BLUE, _GREEN = (240, 120, 20), (40, 110, 235), (20, 190, 70)


def draw_fused(
    dataset: BopDataset,
    results: Mapping[str, Results],
    scene_id: int,
    im_id: int,
    obj_id: int,
    *,
    principal: str,
    max_views: int = 3,
    size: int = 420,
) -> Image | None:
    """Draw one object from two sides: the principal's estimates from each and the fused pose.

    The other side is the view farthest from the first. Camera poses are the dataset's own.

    Returns
    -------
        The sheet; None if the fused pose rests on one view only.
    """
    motion = read_camera_motion(dataset.scenes, dataset.sensor)
    scene = {name: table.select(table.scene_id == scene_id) for name, table in results.items()}
    name, models = dataset.name, {dataset.name: dataset.models}
    alone = fuse_estimates({principal: scene[principal]}, dataset=name, models=models, max_views=1)
    fused = fuse_estimates(
        scene,
        motion,
        dataset=name,
        models=models,
        principal=principal,
        views_from="all",
        max_views=max_views,
    )
    row = _row(fused, im_id, obj_id)
    entered = fused.poses.used[row].any(axis=1)
    views = [int(view) for view in fused.gathered.view_im_id[row][entered]]
    known = {*zip(alone.instances.im_id.tolist(), alone.instances.obj_id.tolist(), strict=True)}
    others = [view for view in views if view != im_id and (view, obj_id) in known]
    if not others:
        return None
    images = (im_id, others[0])
    poses = [
        _drawn(alone, motion, (scene_id, image, obj_id), f"{principal}, {side} image alone", colour)
        for image, side, colour in zip(images, ("left", "right"), (_ORANGE, _BLUE), strict=True)
    ]
    shown = ", two shown" if len(views) > 2 else ""
    count = f"fused from {len(views)} images{shown}"
    poses.append(_drawn(fused, motion, (scene_id, im_id, obj_id), count, _GREEN))
    poses = [_with_error(pose, dataset, motion, (scene_id, im_id, obj_id)) for pose in poses]
    sides = [
        Side(
            f"{dataset.name}-{obj_id} in image {scene_id}/{image}",
            dataset.image(scene_id, image),
            dataset.camera_of(scene_id, image).K,
            motion.world_T_cam[scene_id, image],
        )
        for image in images
    ]
    path = dataset.root / "models" / f"obj_{obj_id:06d}.ply"
    mesh, _ = read_coloured_mesh(path)
    note = "outline: the pose; ellipse: its position within two standard deviations"
    return two_sides(sides, mesh, poses, note, size)


def _row(fused: FusedEstimates, im_id: int, obj_id: int) -> int:
    """Return the first instance of an object in an image."""
    keys = fused.instances
    rows = np.flatnonzero((keys.im_id == im_id) & (keys.obj_id == obj_id))
    if not len(rows):
        raise InputError(f"image {im_id} has no estimate of object {obj_id}")
    return int(rows[0])


def _drawn(
    fused: FusedEstimates,
    motion: CameraMotion,
    where: tuple[int, int, int],
    name: str,
    colour: tuple[int, int, int],
) -> DrawnPose:
    """Carry a pose and its position's covariance from its camera's frame into the world's."""
    scene_id, im_id, obj_id = where
    row, world_T_cam = _row(fused, im_id, obj_id), motion.world_T_cam[scene_id, im_id]
    turn = world_T_cam[:3, :3]
    covariance = turn @ fused.poses.covariance[row, :3, :3] @ turn.T
    return DrawnPose(name, colour, compose(world_T_cam, fused.poses.cam_T_obj[row]), covariance)


def _with_error(
    pose: DrawnPose, dataset: BopDataset, motion: CameraMotion, where: tuple[int, int, int]
) -> DrawnPose:
    """Add to a pose's name how far its position is from the nearest true one in an image."""
    scene_id, im_id, obj_id = where
    truth = dataset.ground_truth
    mine = (truth.scene_id == scene_id) & (truth.im_id == im_id) & (truth.obj_id == obj_id)
    if not mine.any():
        return pose
    world_T_cam = motion.world_T_cam[scene_id, im_id]
    at = compose(world_T_cam[None], truth.cam_T_obj[mine])[:, :3, 3]
    off = 1000 * np.linalg.norm(at - pose.world_T_obj[:3, 3], axis=1).min()
    return replace(pose, name=f"{pose.name}: {off:.0f} mm off")
