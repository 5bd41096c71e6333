"""Fused estimates: the poses of a principal's instances, from several views and estimators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import align, estimate_ids
from graspcast.estimates.checks import (
    impossible,
    refuse_conventions,
    refuse_copies,
    sane_rows,
)
from graspcast.estimates.instances import KEY_COLUMNS, Instances
from graspcast.io.arguments import NAME, a, checked, mapping, number
from graspcast.io.progress import Progress
from graspcast.io.wording import counted
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from graspcast.views.choice import MIN_PARALLAX_RAD, ViewRules, ViewsFrom
from graspcast.views.fusion import FusedPoses, fuse_poses
from graspcast.views.gathering import Gathered, gather
from graspcast.views.motion import Motion
from graspcast.views.motion_checks import check_motion
from graspcast.views.object_motion import ObjectMotion
from graspcast.views.spread import Spreads

if TYPE_CHECKING:
    from polars import DataFrame

__all__ = [
    "FusedEstimates",
    "check_estimators",
    "checked_estimates",
    "fuse_estimates",
    "fuse_gathered",
    "fuse_sane",
    "view_rules",
]

_HALF_SCORE_M, _NONE = 0.01, np.eye(4)[None]
_CONTRADICT = ("that contradicts", "that contradict")


@dataclass(frozen=True, eq=False, repr=False)
class FusedEstimates:
    """Fused poses of a principal's instances.

    Attributes
    ----------
    estimators
        Those that were fused, in order.
    principal
        Whose instances they are.
    instances
        Their keys, with the principal's ``est_id``.
    poses
        Poses, covariances, and who entered.
    gathered
        Which views and estimates there were.
    notes
        What was left out or could not be checked, in words.
    """

    estimators: tuple[str, ...]
    principal: str
    instances: Instances
    poses: FusedPoses
    gathered: Gathered
    notes: tuple[str, ...] = field(default=())

    def __len__(self) -> int:
        return len(self.instances)

    def __repr__(self) -> str:
        return f"FusedEstimates({', '.join(self.estimators)}; {self.instances!r})"

    @property
    def score(self) -> Float[ndarray, " n"]:
        """``1 / (1 + s / 10 mm)``, s the standard deviation of the position, (n,)."""
        total = np.trace(self.poses.covariance[:, :3, :3], axis1=1, axis2=2)
        return 1 / (1 + np.sqrt(total) / _HALF_SCORE_M)

    @property
    def views(self) -> Int[ndarray, " n"]:
        """How many views entered, (n,)."""
        return _any(self.poses.used).sum(axis=1)

    @property
    def results(self) -> Results:
        """The fused poses as an estimator's results, with :attr:`score`."""
        n, keys = len(self), self.instances
        return Results(
            scene_id=keys.scene_id,
            im_id=keys.im_id,
            obj_id=keys.obj_id,
            score=self.score,
            cam_T_obj=self.poses.cam_T_obj,
            time_s=np.full(n, -1.0),
            line=np.zeros(n, dtype=np.int64),
            source="fused",
        )

    def table(self) -> DataFrame:
        """Return keys, spreads, counts and covariances as a table, one row an instance.

        ``est_id`` is the rank in :attr:`results`, ``principal_est_id`` the principal's.
        Covariances are the upper triangles of the 6x6 matrices of position (m) and rotation vector
        (rad): ``cov_cam_XY`` in the camera's axes, ``cov_obj_XY`` in the object's, X and Y from 0.
        """
        import polars as pl

        poses, used = self.poses, self.poses.used
        frame = self.instances.frame().with_columns(
            est_id=pl.Series(estimate_ids(self.results)),
            principal_est_id=pl.Series(self.instances.est_id),
        )
        columns: dict[str, ndarray] = {
            "score": self.score,
            "views": self.views,
            "estimates": used.sum(axis=(1, 2)),
            "dropped_views": (_any(poses.dropped) & ~_any(used)).sum(axis=1),
            "dropped_estimates": poses.dropped.sum(axis=(1, 2)),
            "doubtful_views": self.gathered.doubtful,
            "own_image_dropped": ~_any(used)[:, 0],
            "parallax_deg": np.rad2deg(poses.parallax_rad),
            "along_m": poses.along_m,
            "across_m": poses.across_m,
            "rotation_rad": poses.rotation_rad,
        }
        for frame_name, matrix in (("cam", poses.covariance), ("obj", poses.covariance_obj)):
            for i, j in zip(*np.triu_indices(6), strict=True):
                columns[f"cov_{frame_name}_{i}{j}"] = matrix[:, i, j]
        first = [*KEY_COLUMNS, "principal_est_id"]
        return frame.select(first).with_columns(
            *(pl.Series(name, values) for name, values in columns.items())
        )

    def summary(self) -> list[str]:
        """Say how many views entered, and what was dropped and why, in words."""
        used, dropped = self.poses.used, self.poses.dropped
        counts = ", ".join(
            f"{int((self.views == v).sum())} from {counted(int(v), 'view')}"
            for v in np.unique(self.views)
        )
        lines = [f"{counted(len(self), 'instance')}: {counts}", *self.gathered.single_views()]
        views = int((_any(dropped) & ~_any(used)).sum())
        own = int((~_any(used)[:, 0]).sum())
        alone = int((dropped & _any(used)[..., None]).sum())
        if views:
            lines.append(
                f"dropped {counted(views, 'view', *_CONTRADICT)} the others (a moved object, a "
                "wrong association or a gross error)"
            )
        if own:
            lines.append(
                f"of these, {own} {'is' if own == 1 else 'are'} the judged image's own: if objects "
                "may have been moved before it, do not rely on these poses (own_image_dropped)"
            )
        if alone:
            names = [
                f"{name} {int((dropped & _any(used)[..., None])[..., k].sum())}"
                for k, name in enumerate(self.estimators)
            ]
            which = counted(alone, "estimate", *_CONTRADICT)
            lines.append(f"dropped {which} the rest: {', '.join(names)}")
        return lines


@checked(
    results=mapping(a(Results), "estimator"),
    motion=a(Motion, words="a CameraMotion or another Motion"),
    dataset=NAME,
    principal=NAME,
    models=mapping(a(Models), "dataset"),
    noise=a(CameraNoise),
    views_from=NAME,
    max_views=number(1.0, 1000.0),
    min_parallax_rad=number(0.0, np.pi),
    spreads=a(Spreads),
)
def fuse_estimates(
    results: Mapping[str, Results],
    motion: Motion | None = None,
    *,
    dataset: str,
    principal: str | None = None,
    models: Mapping[str, Models] | None = None,
    noise: CameraNoise | None = None,
    views_from: ViewsFrom = "earlier",
    max_views: int = 3,
    min_parallax_rad: float = MIN_PARALLAX_RAD,
    spreads: Spreads | None = None,
    progress: Progress | None = None,
) -> FusedEstimates:
    """Fuse K >= 1 estimators' poses over the views of static scenes.

    Parameters
    ----------
    results
        Estimator's name to its results on one dataset.
    motion
        Of the camera between the images of a scene, as a rule
        :class:`~graspcast.views.camera_motion.CameraMotion`; None fuses the estimators of each
        image alone.
    dataset
        The dataset's name.
    principal
        The estimator whose estimates are the instances; by default the first.
    models
        Dataset's name to its object models: symmetries, and diameters for checks.
    noise
        Standard deviations of the camera motion, beside what ``motion`` itself states; none by
        default.
    views_from
        ``earlier`` images of the scene alone (smaller ``im_id``), or ``all``.
    max_views
        At most this many, the judged image included.
    min_parallax_rad
        Least angle between any two of them, seen from the object.
    spreads
        Of :func:`~graspcast.views.spread.learn_spreads`; the default for every estimator otherwise.
    progress
        Called with the share done, and the number of objects in images.

    Raises
    ------
    InputError
        If there is no estimate, or an option is not known.
    UnknownNameError
        For a principal that is none of the estimators.
    MismatchError
        If the camera motion is of other scenes, or contradicts the estimates; or an estimator's
        poses agree with the others' only in another convention.
    """
    if not results:
        raise InputError("there are no estimates to fuse", parameters=("estimates",))
    principal = principal or next(iter(results))
    if principal not in results:
        raise UnknownNameError("estimator", principal, tuple(results), parameters=("principal",))
    rules = view_rules(views_from, max_views, min_parallax_rad, noise)
    sane, notes = checked_estimates(results, motion, [principal], dataset=dataset, models=models)
    of: dict[str, Any] = {"dataset": dataset, "principal": principal, "models": models}
    spreads = spreads or Spreads()
    return fuse_sane(sane, motion, rules, spreads, notes=notes, progress=progress, **of)


@checked(
    views_from=NAME,
    max_views=number(1.0, 1000.0),
    min_parallax_rad=number(0.0, np.pi),
    noise=a(CameraNoise, type(None), words="a CameraNoise, or None"),
)
def view_rules(
    views_from: ViewsFrom, max_views: int, min_parallax_rad: float, noise: CameraNoise | None
) -> ViewRules:
    """Return the rules of :func:`fuse_estimates`.

    Raises
    ------
    InputError
        If one is not known.
    """
    if views_from not in ("earlier", "all"):
        raise InputError(f"views_from should be 'earlier' or 'all', not {views_from!r}")
    if max_views != int(max_views):
        raise InputError(f"max_views should be a whole number, not {max_views}")
    return ViewRules(views_from, int(max_views), float(min_parallax_rad), noise or CameraNoise())


def checked_estimates(
    results: Mapping[str, Results],
    motion: Motion | None,
    principals: Sequence[str],
    *,
    dataset: str,
    models: Mapping[str, Models] | None,
) -> tuple[dict[str, Results], list[str]]:
    """Return the sane rows of all estimators, checked against each other and the motion, and notes.

    Raises
    ------
    InputError
        If none of the principals has an estimate.
    MismatchError
        As :func:`fuse_estimates`.
    """
    tables, _, left_out = sane_rows(results, dataset, models)
    sane, notes = dict(zip(results, tables, strict=True)), list(left_out)
    anchor = next((name for name in principals if len(sane[name])), None)
    if anchor is None:
        who = f"{results[principals[0]].source}: {principals[0]} has no"
        if len(principals) > 1:
            who = f"none of {', '.join(principals)} has an"
        raise InputError(f"{who} estimate to fuse", parameters=("estimates", "principal"))
    check_estimators(sane, dataset, anchor, models)
    if motion is not None:
        scenes = {s for table in sane.values() for s in set(table.scene_id.tolist())}
        if not scenes & motion.scenes:
            raise MismatchError(
                f"{motion.source}: the camera motion is of other scenes "
                f"({min(motion.scenes, default='none')} …) than the estimates ({min(scenes)} …)",
                parameters=("camera_poses",),
            )
        if isinstance(motion, CameraMotion):
            notes += filter(None, [check_motion(sane, motion)])
    return sane, notes


def fuse_sane(
    sane: Mapping[str, Results],
    motion: Motion | None,
    rules: ViewRules,
    spreads: Spreads,
    *,
    dataset: str,
    principal: str,
    models: Mapping[str, Models] | None,
    notes: Sequence[str] = (),
    progress: Progress | None = None,
) -> FusedEstimates:
    """Gather and fuse estimates that have passed all checks; see :func:`fuse_estimates`."""
    symmetries = _symmetries(dataset, models)
    gathered = gather(sane, motion, dataset, principal, spreads, symmetries, rules, progress)
    return fuse_gathered(
        gathered,
        spreads,
        names=tuple(sane),
        dataset=dataset,
        principal=principal,
        models=models,
        notes=notes,
        own_image_stays=isinstance(motion, ObjectMotion) and motion.estimated,
    )


def fuse_gathered(
    gathered: Gathered,
    spreads: Spreads,
    *,
    names: tuple[str, ...],
    dataset: str,
    principal: str,
    models: Mapping[str, Models] | None,
    notes: Sequence[str] = (),
    own_image_stays: bool = False,
) -> FusedEstimates:
    """Fuse estimates that were gathered from views."""
    keys, symmetries = gathered.instances, _symmetries(dataset, models)
    poses = fuse_poses(
        gathered.view_T_obj,
        gathered.cam_T_view,
        gathered.present,
        spreads.table(names, keys.objects),
        noise=gathered.noise,
        motion_covariance=gathered.motion_covariance,
        symmetries=[symmetries.get(o, _NONE) for o in keys.obj_id.tolist()],
        principal=names.index(principal),
        own_image_stays=own_image_stays,
    )
    found = impossible(poses.cam_T_obj, keys, models)
    return FusedEstimates(names, principal, keys, poses, gathered, (*notes, *found))


def check_estimators(
    results: Mapping[str, Results],
    dataset: str,
    principal: str,
    models: Mapping[str, Models] | None,
) -> None:
    """Raise if two estimators are one, or the poses of one are in another convention."""
    if len(results) < 2:
        return
    common = align(results, dataset=dataset, anchor=principal, required=False)
    if len(common):
        refuse_copies(common.estimators, common.cam_T_obj)
        mine = (models or {}).get(dataset)
        refuse_conventions(common.estimators, common.cam_T_obj, common.obj_id, mine)


def _any(entries: Bool[ndarray, "n v k"]) -> Bool[ndarray, "n v"]:
    """Return which views have an entry."""
    return np.asarray(entries.any(axis=2))


def _symmetries(dataset: str, models: Mapping[str, Models] | None) -> dict[int, ndarray]:
    mine = models[dataset].info if models and dataset in models else {}
    return {obj_id: info.symmetries for obj_id, info in mine.items()}
