"""Motion from objects: how the camera moved, from the poses of other objects in both images.

From ground truth for datasets whose objects were rearranged between the images: there the motion
differs from object to object. From estimates where the camera's motion is not known. Never from the
judged object itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.dataset import GroundTruth
from graspcast.bop.models import Models
from graspcast.bop.results import Results, score_order
from graspcast.errors import InputError
from graspcast.estimates.checks import sane_rows
from graspcast.estimates.instances import object_name
from graspcast.io.arguments import NAME, a, checked, mapping
from graspcast.io.wording import counted
from graspcast.views.fusion import fuse_poses
from graspcast.views.motion import RefinedMotions, ViewMotions
from graspcast.views.object_consensus import (
    ObjectPoses,
    Statements,
    agreement,
    fit_motion,
    medoid,
    statements,
)
from graspcast.views.spread import Spreads

__all__ = ["ObjectMotion"]

_TRUE_WITHIN = (0.015, float(np.deg2rad(4.0)))
"""Objects that moved together: metres, radians."""
_ESTIMATED_WITHIN = (0.04, 0.035, float(np.deg2rad(12.0)))
"""Estimates that state the same motion: as a share of the distance, at least metres; radians."""
_LEAST_OBJECTS = 2
_MOST_SYMMETRIES = 8
"""An object with more (a discretised axis of revolution) does not state how the camera turned."""
_SUPPORTS = 20.0
"""Squared Mahalanobis distance, of six degrees of freedom, within which an object agrees."""
_ALONE = np.eye(4)[None]


@dataclass(frozen=True, eq=False)
class _Scene:
    """The poses of o objects in i images of a scene."""

    place: Mapping[int, int]
    objects: tuple[int, ...]
    poses: ObjectPoses


class ObjectMotion:
    """The camera's motion as other objects state it that stood still beside the judged one.

    Built by :meth:`from_ground_truth` or :meth:`from_estimates`; a
    :class:`~graspcast.views.motion.Motion`. An image serves where at least two other objects agree.
    """

    def __init__(
        self,
        tables: Mapping[int, _Scene],
        symmetries: Mapping[int, Float[ndarray, "s 4 4"]],
        source: str,
        *,
        true: bool,
    ):
        self._tables, self._symmetries = tables, symmetries
        self._source, self._true = source, true

    def __repr__(self) -> str:
        images = sum(len(scene.place) for scene in self._tables.values())
        of = f"{counted(images, 'image')} of {counted(len(self._tables), 'scene')}"
        return f"ObjectMotion({of}, {self._source})"

    @property
    def source(self) -> str:
        """Where it came from, for messages."""
        return self._source

    @property
    def scenes(self) -> set[int]:
        """The scenes with poses of objects."""
        return set(self._tables)

    @property
    def estimated(self) -> bool:
        """Whether it rests on estimates: then nothing says that the judged object stood still."""
        return not self._true

    @classmethod
    @checked(ground_truth=a(GroundTruth), models=a(Models))
    def from_ground_truth(
        cls, ground_truth: GroundTruth, models: Models | None = None
    ) -> ObjectMotion:
        """Take the motion from annotated poses, for the evaluation of datasets.

        An image serves for an object if at least two others moved rigidly with it, to 15 mm and 4
        degrees; the motion is fitted to the annotated poses of these. The judged object's own
        annotation decides which objects moved with it, and is not fitted. An object that is
        annotated more than once in an image does not count there.

        Parameters
        ----------
        ground_truth
            The annotated poses.
        models
            For symmetries; without, there are none.
        """
        keys = np.stack([ground_truth.scene_id, ground_truth.im_id, ground_truth.obj_id], axis=1)
        _, first, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
        rows = first[count == 1]
        n, (length, angle) = len(rows), _TRUE_WITHIN
        tables = _tables(
            keys[rows],
            ground_truth.cam_T_obj[rows],
            np.tile((length / 3) ** 2 * np.eye(3), (n, 1, 1)),
            np.full(n, (angle / 3) ** 2),
        )
        return cls(tables, _symmetries(models), ground_truth.source, true=True)

    @classmethod
    @checked(
        results=mapping(a(Results), "estimator"),
        dataset=NAME,
        models=mapping(a(Models), "dataset"),
        spreads=a(Spreads),
    )
    def from_estimates(
        cls,
        results: Mapping[str, Results],
        *,
        dataset: str,
        models: Mapping[str, Models] | None = None,
        spreads: Spreads | None = None,
    ) -> ObjectMotion:
        """Estimate the motion from the estimates of the other objects in both images.

        The estimators' best estimates of each object in an image are fused; the motion is fitted
        to the objects by least squares with Cauchy weights. Its covariance enters the fusion. It
        must be of a scene in which most objects stand still.

        Parameters
        ----------
        results
            Estimator's name to its results on one dataset.
        dataset
            The dataset's name.
        models
            Dataset's name to its object models, for symmetries.
        spreads
            Of :func:`~graspcast.views.spread.learn_spreads`.

        Raises
        ------
        InputError
            If there is no estimate.
        """
        names = tuple(results)
        tables, _, _ = sane_rows(results, dataset, models)
        best: dict[tuple[int, int, int], list[int]] = {}
        for k, table in enumerate(tables):
            columns = np.stack([table.scene_id, table.im_id, table.obj_id], axis=1).tolist()
            for row in score_order(table).tolist()[::-1]:  # the best one last
                best.setdefault(tuple(columns[row]), [-1] * len(names))[k] = row
        if not best:
            raise InputError("no estimate to take the motion from", parameters=("estimates",))
        keys, rows = np.array(list(best)), np.array(list(best.values()))
        poses = np.tile(np.eye(4), (*rows.shape, 1, 1))
        for k, table in enumerate(tables):
            poses[rows[:, k] >= 0, k] = table.cam_T_obj[rows[rows[:, k] >= 0, k]]
        mine = _symmetries((models or {}).get(dataset))
        objects = np.array([object_name(dataset, o) for o in keys[:, 2].tolist()])
        fused = fuse_poses(
            poses[:, None],
            np.tile(np.eye(4), (len(keys), 1, 1, 1)),
            rows[:, None] >= 0,
            (spreads or Spreads()).table(names, objects),
            symmetries=[mine.get(o, _ALONE) for o in keys[:, 2].tolist()],
        )
        position, turn = fused.covariance[:, :3, :3], fused.rotation_rad**2
        scenes = _tables(keys, fused.cam_T_obj, position, turn)
        return cls(scenes, mine, "the estimates of other objects", true=False)

    def views_of(
        self, scene_id: int, im_id: int, obj_id: int, others: Sequence[int]
    ) -> ViewMotions:
        """Return which of the other images serve: those in which two other objects agree.

        See :meth:`graspcast.views.motion.Motion.views_of`.
        """
        scene = self._tables.get(scene_id)
        if scene is None or im_id not in scene.place:
            return _none("are in images without an annotated object" if self._true else "")
        if self._true and not self._known(scene, im_id, obj_id):
            return _none("are not annotated once in their image")
        some = [i for i in others if i in scene.place]
        pair = _Pair(self, scene, im_id, obj_id, [scene.place[i] for i in some])
        serves, rough = pair.consensus()
        numbers = np.flatnonzero(serves)
        what = (
            "since fewer than two other objects moved with the judged one"
            if self._true
            else "since fewer than two other objects agree on the motion"
        )
        left_out = {what: len(others) - len(numbers)} if len(numbers) < len(others) else {}
        why = f"have no view, {what}" if others and not len(numbers) else ""

        def refine(chosen: Int[ndarray, " b"]) -> RefinedMotions:
            good, poses, covariance = pair.fitted(numbers[chosen])
            return RefinedMotions(good, poses, covariance, what)

        return ViewMotions(
            np.array(some, dtype=np.int64)[numbers],
            rough[numbers],
            np.zeros((len(numbers), 2)),
            left_out,
            why,
            refine,
        )

    def _known(self, scene: _Scene, im_id: int, obj_id: int) -> bool:
        place = scene.place[im_id]
        return obj_id in scene.objects and bool(
            scene.poses.present[place, scene.objects.index(obj_id)]
        )


class _Pair:
    """An object in an image, and the other images of its scene."""

    def __init__(
        self, motion: ObjectMotion, scene: _Scene, im_id: int, obj_id: int, places: list[int]
    ):
        self.true = motion._true
        self.cam = scene.poses.at(scene.place[im_id])
        self.views = scene.poses.at(np.array(places, dtype=np.int64))
        self.symmetries = [motion._symmetries.get(o, _ALONE) for o in scene.objects]
        self.me = scene.objects.index(obj_id) if obj_id in scene.objects else -1
        states = [
            (o, symmetry)
            for o, symmetry in enumerate(self.symmetries)
            if o != self.me and len(symmetry) <= _MOST_SYMMETRIES
        ]
        self.stated = statements(self.cam, self.views, states)
        self.allowed = self.stated.present.copy()
        if self.true:
            apart, turned = agreement(
                self.stated,
                self.cam.cam_T_obj[self.me],
                self.views.cam_T_obj[:, self.me],
                self.symmetries[self.me],
            )
            together = (apart < _TRUE_WITHIN[0]) & (turned < _TRUE_WITHIN[1])
            self.allowed &= together & self.views.present[:, self.me, None]

    def objects(self, rows: Int[ndarray, " b"]) -> Bool[ndarray, "b o"]:
        """Return the objects that count for some of the pairs."""
        out = np.zeros((len(rows), len(self.symmetries)), dtype=bool)
        for h, o in enumerate(self.stated.owner.tolist()):
            out[:, o] |= self.allowed[rows, h]
        return out

    def consensus(self) -> tuple[Bool[ndarray, " m"], Float[ndarray, "m 4 4"]]:
        """Return for which images at least two objects agree, and roughly the motion."""
        every = np.arange(len(self.allowed))
        if not len(self.stated.owner):
            return np.zeros(len(every), dtype=bool), np.tile(np.eye(4), (len(every), 1, 1))
        if self.true:
            serves = self.objects(every).sum(axis=1) >= _LEAST_OBJECTS
            best = self.allowed.argmax(axis=1)
        else:
            best, count = self._medoid(every)
            serves = count[every, best] >= _LEAST_OBJECTS
        return serves, self.stated.cam_T_view[every, best]

    def _medoid(self, rows: Int[ndarray, " b"]) -> tuple[Int[ndarray, " b"], Int[ndarray, "b h"]]:
        there = self.objects(rows)[..., None]
        position = self.views.cam_T_obj[rows, :, :3, 3]
        at = (position * there).sum(axis=1) / np.maximum(there.sum(axis=1), 1)
        scale = _TRUE_WITHIN
        if not self.true:
            far = np.linalg.norm(at, axis=1)
            share, least, angle = _ESTIMATED_WITHIN
            scale = (max(share * float(np.median(far)) if len(far) else 0.0, least), angle)
        stated = self.stated
        some = Statements(
            stated.cam_T_view[rows], stated.owner, stated.symmetry, stated.present[rows]
        )
        return medoid(some, self.allowed[rows], at, scale)

    def fitted(
        self, rows: Int[ndarray, " b"]
    ) -> tuple[Bool[ndarray, " b"], Float[ndarray, "b 4 4"], Float[ndarray, "b 6 6"]]:
        """Return for which of the pairs the fit holds, the motions and their covariances."""
        best, _ = self._medoid(rows)
        start = self.stated.cam_T_view[rows, best]
        there = self.objects(rows)
        poses, covariance, distance = fit_motion(
            start, self.cam, self.views.at(rows), there, self.symmetries
        )
        weight = there / (1 + distance / 6.0)
        freedom = 6.0 * np.maximum(weight.sum(axis=1) - 1, 1.0)
        scale = (weight * distance).sum(axis=1) / freedom
        if not self.true:
            scale = np.maximum(scale, 1.0)
        good = (there & (distance <= _SUPPORTS)).sum(axis=1) >= _LEAST_OBJECTS
        return good | self.true, poses, covariance * scale[:, None, None]


def _none(why: str) -> ViewMotions:
    return ViewMotions(np.zeros(0, np.int64), np.zeros((0, 4, 4)), np.zeros((0, 2)), why=why)


def _symmetries(models: Models | None) -> dict[int, ndarray]:
    return {} if models is None else {o: i.symmetries for o, i in models.info.items()}


def _tables(
    keys: Int[ndarray, "n 3"],
    poses: Float[ndarray, "n 4 4"],
    covariance: Float[ndarray, "n 3 3"],
    rotation_variance: Float[ndarray, " n"],
) -> dict[int, _Scene]:
    """Sort poses by scene, image and object."""
    out = {}
    for scene_id in np.unique(keys[:, 0]).tolist():
        rows = np.flatnonzero(keys[:, 0] == scene_id)
        images, i = np.unique(keys[rows, 1], return_inverse=True)
        objects, o = np.unique(keys[rows, 2], return_inverse=True)
        shape = (len(images), len(objects))
        table = ObjectPoses(
            np.tile(np.eye(4), (*shape, 1, 1)),
            np.zeros(shape, dtype=bool),
            np.tile(np.eye(3), (*shape, 1, 1)),
            np.ones(shape),
        )
        table.cam_T_obj[i, o], table.present[i, o] = poses[rows], True
        table.covariance[i, o], table.rotation_variance[i, o] = (
            covariance[rows],
            rotation_variance[rows],
        )
        place = {image: at for at, image in enumerate(images.tolist())}
        out[scene_id] = _Scene(place, tuple(objects.tolist()), table)
    return out
