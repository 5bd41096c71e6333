"""Gathering of the estimates of each instance from the views of its scene."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.results import Results, score_order
from graspcast.estimates.alignment import estimate_ids, partners
from graspcast.estimates.instances import InstanceKey, Instances, object_name
from graspcast.io.wording import counted
from graspcast.views.association import associate_views
from graspcast.views.candidates import Candidates
from graspcast.views.choice import ViewRules
from graspcast.views.motion import Motion
from graspcast.views.spread import Spreads

__all__ = ["Gathered", "ViewRules", "gather"]

_NO_POSE = "have no camera pose"
_NO_MATCH = "have no estimate in another view that is surely of the same instance"
_SINGULAR = {"have": "has", "are": "is"}
_ALONE = np.eye(4)[None]
ImageObject = tuple[int, int, int]


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
    noise
        Standard deviations of that motion, translation (m) and rotation (rad), (n, V, 2).
    motion_covariance
        What its uncertainty has beyond that: of position (m) and rotation vector (rad), in the
        judged camera's axes, about the judged camera's centre, (n, V, 6, 6).
    view_im_id
        The views' images, -1 where there is none, (n, V).
    est_id
        Each estimator's own ``est_id`` of its estimate in the judged image, -1 where there is none,
        (n, K).
    score
        The estimators' scores of these estimates, NaN where there is none, (n, K).
    doubtful
        How many views were left out since it is not sure which instance is which, (n,).
    single
        Why instances have one view only, with how many.
    left_out
        Why images do not serve as views, with how many.
    """

    instances: Instances
    view_T_obj: Float[ndarray, "n v k 4 4"]
    present: Bool[ndarray, "n v k"]
    cam_T_view: Float[ndarray, "n v 4 4"]
    noise: Float[ndarray, "n v 2"]
    motion_covariance: Float[ndarray, "n v 6 6"]
    view_im_id: Int[ndarray, "n v"]
    est_id: Int[ndarray, "n k"]
    score: Float[ndarray, "n k"]
    doubtful: Int[ndarray, " n"]
    single: Mapping[str, int] = field(default_factory=dict)
    left_out: Mapping[str, int] = field(default_factory=dict)

    def select(self, which: Bool[ndarray, " n"] | Int[ndarray, " m"]) -> Gathered:
        """Return some of the instances, by mask or by number."""
        names = [f.name for f in fields(self) if f.name not in ("instances", "single", "left_out")]
        columns = {name: getattr(self, name)[which] for name in names}
        return Gathered(instances=self.instances.select(which), **columns)

    def single_views(self) -> list[str]:
        """Say why instances have one view only, and how many views were left out in doubt."""
        lines = [
            f"single views: {counted(n, 'instance')} {why if n > 1 else _of_one(why)}"
            for why, n in self.single.items()
        ]
        lines += [f"left out {counted(n, 'view')} {why}" for why, n in self.left_out.items()]
        if total := int(self.doubtful.sum()):
            lines.append(
                f"left out {counted(total, 'view')} in which it is not sure which of several "
                "instances is which"
            )
        return lines


def _of_one(why: str) -> str:
    """Return what is said of several instances as it is said of one."""
    verb, space, rest = why.partition(" ")
    return f"{_SINGULAR.get(verb, verb)}{space}{rest}"


class _Gatherer:
    """The rows of all estimators by image and object, and what was found."""

    def __init__(
        self,
        results: Mapping[str, Results],
        principal: str,
        motion: Motion | None,
        spread: Mapping[int, Float[ndarray, "k 4"]],
        symmetries: Mapping[int, Float[ndarray, "s 4 4"]],
        rules: ViewRules,
    ):
        self.tables = list(results.values())
        self.first = list(results).index(principal)
        self.motion = None if rules.max_views == 1 else motion
        self.spread, self.symmetries, self.rules = spread, symmetries, rules
        self.rows: list[dict[ImageObject, list[int]]] = [_by_image(t) for t in self.tables]
        self.images: dict[tuple[int, int], list[int]] = {}
        for scene_id, im_id, obj_id in sorted({key for rows in self.rows for key in rows}):
            self.images.setdefault((scene_id, obj_id), []).append(im_id)
        self.single: Counter[str] = Counter()
        self.left_out: Counter[str] = Counter()

    def candidates(self, key: ImageObject) -> Candidates | None:
        """Return the images that may serve for an object in an image, or None if none shall."""
        scene_id, im_id, obj_id = key
        if self.motion is None:
            return None
        earlier = self.rules.views_from == "earlier"
        others = [
            other
            for other in self.images[scene_id, obj_id]
            if other != im_id and not (earlier and other > im_id)
        ]
        views = self.motion.views_of(scene_id, im_id, obj_id, others)
        self.left_out.update(views.left_out)
        return Candidates(views, self.rules, self.left_out)

    def chosen(self, views: Candidates | None, pose: Float[ndarray, "4 4"]) -> list[int]:
        """Return the numbers of the views that serve for an instance; if none do, count why."""
        if views is None:
            if self.rules.max_views > 1:
                self.single[_NO_POSE] += 1
            return []
        found, why = views.chosen(pose)
        if why:
            self.single[why] += 1
        return found

    def found(
        self, key: ImageObject, anchors: Float[ndarray, "a 4 4"], views: Candidates, number: int
    ) -> tuple[Int[ndarray, "a k"], Bool[ndarray, " a"]]:
        """Return each estimator's row in a view for each of the judged image's instances.

        -1 where there is none; and where it is doubted which instance is which.
        """
        scene_id, _, obj_id = key
        out = np.full((len(anchors), len(self.tables)), -1)
        doubted = np.zeros(len(anchors), dtype=bool)
        for k, table in enumerate(self.tables):
            rows = self.rows[k].get((scene_id, int(views.im_id[number]), obj_id), [])
            if len(rows) == 1 and len(anchors) == 1:
                out[0, k] = rows[0]  # whether it contradicts the others is seen in the fusion
            elif rows:
                which, doubt = associate_views(
                    anchors,
                    table.cam_T_obj[rows],
                    views.cam_T_view[number],
                    (self.spread[obj_id][self.first], self.spread[obj_id][k]),
                    views.noise_at(number, anchors),
                    self.symmetries.get(obj_id, _ALONE),
                )
                out[:, k] = np.where(which >= 0, np.array(rows)[which], -1)
                doubted |= doubt
        out[doubted] = -1
        return out, doubted

    def of_image(self, key: ImageObject) -> list[_Row]:
        """Return the estimates of the principal's instances of an object in an image."""
        together = [by_image.get(key, []) for by_image in self.rows]
        own = [
            [-1 if row is None else row for row in found]
            for found in partners(together, self.first, self.tables)
        ]
        anchors = self.tables[self.first].cam_T_obj[[found[self.first] for found in own]]
        views = self.candidates(key)
        # Of several instances of an image, most share their views.
        by_view: dict[int, tuple[ndarray, ndarray]] = {}
        out = []
        for est_id, found in enumerate(own):
            row = _Row([found], [key[1]])
            chosen = self.chosen(views, anchors[est_id])
            for number in chosen:
                assert views is not None
                if number not in by_view:
                    by_view[number] = self.found(key, anchors, views, number)
                which, doubted = by_view[number]
                row.doubtful += int(doubted[est_id])
                if (which[est_id] >= 0).any():
                    row.rows.append(which[est_id].tolist())
                    row.im_id.append(int(views.im_id[number]))
                    row.cam_T_view.append(views.cam_T_view[number])
                    row.noise.append(views.noise[number])
                    row.covariance.append(views.covariance[number])
            if chosen and len(row.im_id) == 1:
                self.single[_NO_MATCH] += 1
            out.append(row)
        return out


@dataclass(eq=False)
class _Row:
    """The views of one instance, the judged image first: each estimator's row, -1 for none."""

    rows: list[list[int]]
    im_id: list[int]
    cam_T_view: list[ndarray] = field(default_factory=lambda: [np.eye(4)])
    noise: list[ndarray] = field(default_factory=lambda: [np.zeros(2)])
    covariance: list[ndarray] = field(default_factory=lambda: [np.zeros((6, 6))])
    doubtful: int = 0


def gather(
    results: Mapping[str, Results],
    motion: Motion | None,
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
        Of the camera between the images, or None.
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
    numbers = np.unique(results[principal].obj_id)
    objects = np.array([object_name(dataset, int(o)) for o in numbers])
    spread = dict(zip(numbers.tolist(), spreads.table(names, objects), strict=True))
    work = _Gatherer(results, principal, motion, spread, symmetries, rules)
    keys: list[InstanceKey] = []
    rows: list[_Row] = []
    for key in sorted(work.rows[work.first]):
        if rules.images is not None and key[:2] not in rules.images:
            continue
        if key in rules.without:
            continue
        for est_id, row in enumerate(work.of_image(key)):
            keys.append(InstanceKey(dataset, *key, est_id))
            rows.append(row)
    return _filled(work, Instances.of(keys), rows)


def _filled(work: _Gatherer, keys: Instances, found: list[_Row]) -> Gathered:
    """Look up the poses of the rows."""
    n, K = len(found), len(work.tables)
    V = max((len(row.im_id) for row in found), default=1)
    rows = np.full((n, V, K), -1)
    view_im_id = np.full((n, V), -1)
    cam_T_view = np.tile(np.eye(4), (n, V, 1, 1))
    noise, covariance = np.zeros((n, V, 2)), np.zeros((n, V, 6, 6))
    for i, row in enumerate(found):
        there = slice(len(row.im_id))
        rows[i, there], view_im_id[i, there] = row.rows, row.im_id
        cam_T_view[i, there], noise[i, there] = row.cam_T_view, row.noise
        covariance[i, there] = row.covariance
    poses = np.tile(np.eye(4), (n, V, K, 1, 1))
    est_id, score = np.full((n, K), -1), np.full((n, K), np.nan)
    for k, table in enumerate(work.tables):
        is_there = rows[..., k] >= 0
        poses[:, :, k][is_there] = table.cam_T_obj[rows[..., k][is_there]]
        judged = is_there[:, 0]
        est_id[judged, k] = estimate_ids(table)[rows[judged, 0, k]]
        score[judged, k] = table.score[rows[judged, 0, k]]
    return Gathered(
        keys,
        poses,
        rows >= 0,
        cam_T_view,
        noise,
        covariance,
        view_im_id,
        est_id,
        score,
        np.array([row.doubtful for row in found], dtype=np.int64),
        dict(work.single),
        dict(work.left_out),
    )


def _by_image(table: Results) -> dict[ImageObject, list[int]]:
    """Return the rows of each image and object, by decreasing score."""
    keys = np.stack([table.scene_id, table.im_id, table.obj_id], axis=1).tolist()
    out: dict[ImageObject, list[int]] = {}
    for row in score_order(table).tolist():
        scene_id, im_id, obj_id = keys[row]
        out.setdefault((scene_id, im_id, obj_id), []).append(row)
    return out
