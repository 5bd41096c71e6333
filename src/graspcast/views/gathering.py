"""Gathering of the estimates of each instance from the views of its scene."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.results import Results, score_order
from graspcast.estimates.alignment import partners
from graspcast.estimates.instances import InstanceKey, Instances, object_name
from graspcast.pose.transforms import compose
from graspcast.views.association import associate, pair_distances, position_covariance
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from graspcast.views.choice import ViewsFrom, choose_views, viewing_directions
from graspcast.views.spread import Spreads

__all__ = ["Gathered", "ViewRules", "gather"]

_NO_POSE = "have no camera pose"
_NO_IMAGE = "have no {} image with an estimate of the object"
_NO_PARALLAX = "have no {} image from another direction (parallax too small)"
_NO_MATCH = "have no estimate in another view that is surely of the same instance"
_ALONE = np.eye(4)[None]
ImageObject = tuple[int, int, int]


@dataclass(frozen=True)
class ViewRules:
    """Which other images serve.

    Attributes
    ----------
    views_from
        Earlier images alone, or all.
    max_views
        At most this many, the judged one included.
    min_parallax_rad
        Least angle between any two.
    noise
        Of the camera motion.
    images
        The images (scene_id, im_id) whose instances are wanted; None for all.
    """

    views_from: ViewsFrom
    max_views: int
    min_parallax_rad: float
    noise: CameraNoise
    images: frozenset[tuple[int, int]] | None = None


@dataclass(frozen=True, eq=False)
class Gathered:
    """The estimates of n instances in V views by K estimators; view 0 is the judged image.

    Attributes
    ----------
    instances
        Keys, with the principal's ``est_id``.
    view_T_obj
        Poses in each view's camera frame, the identity where there is none, (n, V, K, 4, 4).
    present
        Where there is an estimate, (n, V, K).
    cam_T_view
        Each view's camera in the judged one's frame, (n, V, 4, 4).
    view_im_id
        The views' images, -1 where there is none, (n, V).
    doubtful
        How many views were left out since it is not sure which instance is which, (n,).
    single
        Why instances have one view only, with how many.
    """

    instances: Instances
    view_T_obj: Float[ndarray, "n v k 4 4"]
    present: Bool[ndarray, "n v k"]
    cam_T_view: Float[ndarray, "n v 4 4"]
    view_im_id: Int[ndarray, "n v"]
    doubtful: Int[ndarray, " n"]
    single: Mapping[str, int] = field(default_factory=dict)

    def single_views(self) -> list[str]:
        """Say why instances have one view only, and how many views were left out in doubt."""
        lines = [f"single views: {n} instances {why}" for why, n in self.single.items()]
        if total := int(self.doubtful.sum()):
            lines.append(
                f"left out {total} views in which it is not sure which of several instances is "
                "which"
            )
        return lines


class _Gatherer:
    """The rows of all estimators by image and object, and what was found."""

    def __init__(
        self,
        results: Mapping[str, Results],
        motion: CameraMotion | None,
        spread: Mapping[int, Float[ndarray, "k 4"]],
        symmetries: Mapping[int, Float[ndarray, "s 4 4"]],
        rules: ViewRules,
    ):
        self.tables = list(results.values())
        self.world_T_cam = {} if motion is None else motion.world_T_cam
        self.spread, self.symmetries, self.rules = spread, symmetries, rules
        self.rows: list[dict[ImageObject, list[int]]] = [_by_image(t) for t in self.tables]
        self.images: dict[tuple[int, int], list[int]] = {}
        for scene_id, im_id, obj_id in sorted({key for rows in self.rows for key in rows}):
            if (scene_id, im_id) in self.world_T_cam:
                self.images.setdefault((scene_id, obj_id), []).append(im_id)
        self.single: Counter[str] = Counter()

    def views(self, key: ImageObject, pose: Float[ndarray, "4 4"]) -> list[int]:
        """Return the images that serve for an instance; if none do, count why."""
        scene_id, im_id, obj_id = key
        if self.rules.max_views == 1:
            return []
        if (scene_id, im_id) not in self.world_T_cam:
            self.single[_NO_POSE] += 1
            return []
        earlier = self.rules.views_from == "earlier"
        others = [
            other
            for other in self.images[scene_id, obj_id]
            if other != im_id and not (earlier and other > im_id)
        ]
        kind = "earlier" if earlier else "other"
        if not others:
            self.single[_NO_IMAGE.format(kind)] += 1
            return []
        cam = self.world_T_cam[scene_id, im_id]
        position = (cam @ pose)[:3, 3]
        centres = np.stack([cam, *(self.world_T_cam[scene_id, i] for i in others)])[:, :3, 3]
        towards = viewing_directions(position, centres)
        most = self.rules.max_views - 1
        chosen = choose_views(towards[0], towards[1:], most, self.rules.min_parallax_rad)
        if not len(chosen):
            self.single[_NO_PARALLAX.format(kind)] += 1
        return [others[i] for i in chosen.tolist()]

    def found(
        self, key: ImageObject, anchors: Float[ndarray, "a 4 4"], principal: int, view: int
    ) -> tuple[Int[ndarray, "a k"], Bool[ndarray, " a"]]:
        """Return each estimator's row in a view for each of the judged image's instances.

        -1 where there is none; and where it is doubted which instance is which.
        """
        scene_id, im_id, obj_id = key
        out = np.full((len(anchors), len(self.tables)), -1)
        doubted = np.zeros(len(anchors), dtype=bool)
        for k, table in enumerate(self.tables):
            rows = self.rows[k].get((scene_id, view, obj_id), [])
            if len(rows) == 1 and len(anchors) == 1:
                out[0, k] = rows[0]  # whether it contradicts the others is seen in the fusion
            elif rows:
                cam_T_view = np.linalg.inv(self.world_T_cam[scene_id, im_id])
                cam_T_view = cam_T_view @ self.world_T_cam[scene_id, view]
                which, doubt = self._associated(
                    obj_id, anchors, principal, cam_T_view, table.cam_T_obj[rows], k
                )
                out[:, k] = np.where(which >= 0, np.array(rows)[which], -1)
                doubted |= doubt
        out[doubted] = -1
        return out, doubted

    def _associated(
        self,
        obj_id: int,
        anchors: Float[ndarray, "a 4 4"],
        principal: int,
        cam_T_view: Float[ndarray, "4 4"],
        view_T_obj: Float[ndarray, "b 4 4"],
        estimator: int,
    ) -> tuple[Int[ndarray, " a"], Bool[ndarray, " a"]]:
        symmetries = self.symmetries.get(obj_id, _ALONE)
        mine, other = self.spread[obj_id][principal], self.spread[obj_id][estimator]
        turn = cam_T_view[:3, :3]
        first = position_covariance(anchors[:, :3, 3], mine)
        second = position_covariance(view_T_obj[:, :3, 3], other, self.rules.noise)
        second = turn @ second @ turn.T
        poses = compose(cam_T_view[None], view_T_obj)
        sides = {"a": (anchors, first), "b": (poses, second)}
        angle = float(np.hypot(mine[2], other[2]) / np.sqrt(2) + self.rules.noise.rotation_rad)
        between, of_first, of_second = (
            pair_distances(*sides[i], *sides[j], angle, symmetries) for i, j in ("ab", "aa", "bb")
        )
        return associate(between, of_first, of_second)


def gather(
    results: Mapping[str, Results],
    motion: CameraMotion | None,
    dataset: str,
    principal: str,
    spreads: Spreads,
    symmetries: Mapping[int, Float[ndarray, "s 4 4"]],
    rules: ViewRules,
) -> Gathered:
    """Gather the estimates of the principal's instances from the views of their scenes.

    Parameters
    ----------
    results
        Estimator's name to its results, of poses that can be.
    motion
        Camera poses, or None.
    dataset
        The dataset's name.
    principal
        Whose instances they are.
    spreads, symmetries
        Of estimators, and of objects by number.
    rules
        Which images serve.
    """
    names = tuple(results)
    first = names.index(principal)
    numbers = np.unique(results[principal].obj_id)
    objects = np.array([object_name(dataset, int(o)) for o in numbers])
    spread = dict(zip(numbers.tolist(), spreads.table(names, objects), strict=True))
    work = _Gatherer(results, motion, spread, symmetries, rules)
    keys: list[InstanceKey] = []
    rows: list[ndarray] = []
    images: list[list[int]] = []
    doubtful: list[int] = []
    for key in sorted(work.rows[first]):
        if rules.images is not None and key[:2] not in rules.images:
            continue
        together = [by_image.get(key, []) for by_image in work.rows]
        own = [
            [-1 if row is None else row for row in found]
            for found in partners(together, first, work.tables)
        ]
        anchors = work.tables[first].cam_T_obj[[found[first] for found in own]]
        # Of several instances of an image, most share their views.
        by_view: dict[int, tuple[ndarray, ndarray]] = {}
        for est_id, found in enumerate(own):
            mine, used, doubts = [found], [key[1]], 0
            chosen = work.views(key, anchors[est_id])
            for view in chosen:
                if view not in by_view:
                    by_view[view] = work.found(key, anchors, first, view)
                which, doubted = by_view[view]
                doubts += int(doubted[est_id])
                if (which[est_id] >= 0).any():
                    mine.append(which[est_id].tolist())
                    used.append(view)
            if chosen and len(used) == 1:
                work.single[_NO_MATCH] += 1
            keys.append(InstanceKey(dataset, *key, est_id))
            rows.append(np.array(mine))
            images.append(used)
            doubtful.append(doubts)
    return _filled(work, Instances.of(keys), rows, images, np.array(doubtful, dtype=np.int64))


def _filled(
    work: _Gatherer,
    keys: Instances,
    rows: list[ndarray],
    images: list[list[int]],
    doubtful: Int[ndarray, " n"],
) -> Gathered:
    """Look up the poses of the rows."""
    n, V, K = len(rows), max(map(len, images), default=1), len(work.tables)
    row = np.full((n, V, K), -1)
    view_im_id = np.full((n, V), -1)
    cam_T_view = np.tile(np.eye(4), (n, V, 1, 1))
    for i, (mine, used) in enumerate(zip(rows, images, strict=True)):
        row[i, : len(mine)] = mine
        view_im_id[i, : len(used)] = used
        if len(used) > 1:
            scene_id = int(keys.scene_id[i])
            others = np.stack([work.world_T_cam[scene_id, im_id] for im_id in used[1:]])
            cam_T_view[i, 1 : len(used)] = (
                np.linalg.inv(work.world_T_cam[scene_id, used[0]]) @ others
            )
    poses = np.tile(np.eye(4), (n, V, K, 1, 1))
    for k, table in enumerate(work.tables):
        there = row[..., k] >= 0
        poses[:, :, k][there] = table.cam_T_obj[row[..., k][there]]
    return Gathered(keys, poses, row >= 0, cam_T_view, view_im_id, doubtful, dict(work.single))


def _by_image(table: Results) -> dict[ImageObject, list[int]]:
    """Return the rows of each image and object, by decreasing score."""
    keys = np.stack([table.scene_id, table.im_id, table.obj_id], axis=1).tolist()
    out: dict[ImageObject, list[int]] = {}
    for row in score_order(table).tolist():
        scene_id, im_id, obj_id = keys[row]
        out.setdefault((scene_id, im_id, obj_id), []).append(row)
    return out
