"""Looks: what estimators saw of one static scene, look by look, fused without files.

Looks are numbered from 0, in the order in which they are given; the last one is judged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.errors import InputError, UnknownNameError
from graspcast.estimates.checks import sane_rows
from graspcast.estimates.selection import listed
from graspcast.io.arguments import NAME, a, checked, mapping, number, sequence
from graspcast.pose.conventions import MIN_INSTANCES
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from graspcast.views.choice import MIN_PARALLAX_RAD
from graspcast.views.fused_estimates import FusedEstimates, check_estimators, fuse_sane
from graspcast.views.gathering import ViewRules
from graspcast.views.look import Look
from graspcast.views.motion_checks import check_looks
from graspcast.views.spread import Spreads

__all__ = ["fuse_looks", "fuse_looks_by"]


@checked(
    looks=sequence(a(Look)),
    dataset=NAME,
    principal=NAME,
    models=mapping(a(Models), "dataset"),
    noise=a(CameraNoise),
    max_views=number(1.0, 1000.0),
    min_parallax_rad=number(0.0, np.pi),
    spreads=a(Spreads),
)
def fuse_looks(
    looks: Sequence[Look],
    *,
    dataset: str | None = None,
    principal: str | None = None,
    models: Mapping[str, Models] | None = None,
    noise: CameraNoise | None = None,
    max_views: int = 3,
    min_parallax_rad: float = MIN_PARALLAX_RAD,
    spreads: Spreads | None = None,
) -> FusedEstimates:
    """Fuse K >= 1 estimators' poses over looks at a static scene, for the last look's instances.

    The rules are those of :func:`~graspcast.views.fused_estimates.fuse_estimates`; earlier looks
    serve. Instances have the scene and image of the last look's results, 0 and the look's number
    where objects were given by name; ``gathered.view_im_id`` likewise.

    Parameters
    ----------
    looks
        In the order in which they were taken.
    dataset
        The dataset's name; not needed where objects were given by name.
    principal
        The estimator whose estimates in the last look are the instances; by default the first that
        has one.
    models, noise, max_views, min_parallax_rad, spreads
        As for ``fuse_estimates``.

    Raises
    ------
    InputError
        If there is no look, or the principal has no sane estimate in the last one; for looks of
        several scenes or datasets, and for times that do not increase.
    UnknownNameError
        For a principal that is in no look.
    MismatchError
        If the camera poses agree with the estimates only in another unit, direction or convention,
        or the poses of one estimator with those of others.
    """
    rules = _rules(looks, max_views, min_parallax_rad, noise)
    ready = _prepared(looks, dataset, models)
    names = tuple(ready.sane)
    if principal is None:
        principal = next((name for name in names if ready.judged(name).any()), None)
    if principal not in names and (principal is not None or not names):
        raise UnknownNameError("estimator", str(principal), names, parameters=("principal",))
    if principal is None or not ready.judged(principal).any():
        raise InputError(
            f"no estimate in the last look by {principal or ', '.join(names)}"
            + (f": {'; '.join(ready.notes)}" if ready.notes else ""),
            parameters=("looks", "principal"),
        )
    return ready.fused(principal, None, rules, spreads or Spreads())


def fuse_looks_by(
    looks: Sequence[Look],
    principals: Sequence[str],
    *,
    dataset: str | None = None,
    models: Mapping[str, Models] | None = None,
    noise: CameraNoise | None = None,
    max_views: int = 3,
    min_parallax_rad: float = MIN_PARALLAX_RAD,
    spreads: Spreads | None = None,
) -> list[FusedEstimates]:
    """Fuse looks as :func:`fuse_looks`, each object by the first principal that has an estimate.

    Parameters
    ----------
    looks, dataset, models, noise, max_views, min_parallax_rad, spreads
        As for :func:`fuse_looks`.
    principals
        Names, in the order in which they are preferred.

    Returns
    -------
    One for each principal that has instances; none if the last look holds no sane estimate.

    Raises
    ------
    InputError
        As :func:`fuse_looks`, but for a last look without estimates.
    MismatchError
        As :func:`fuse_looks`.
    """
    rules = _rules(looks, max_views, min_parallax_rad, noise)
    ready = _prepared(looks, dataset, models)
    done: set[int] = set()
    out = []
    for name in principals:
        if name not in ready.sane:
            continue
        table = ready.sane[name]
        objects = set(table.obj_id[ready.judged(name)].tolist()) - done
        if objects:
            out.append(ready.fused(name, objects, rules, spreads or Spreads()))
        done |= objects
    return out


def _check_order(looks: Sequence[Look]) -> None:
    """Raise unless looks are of one scene and their times increase.

    Raises
    ------
    InputError
        Naming the looks.
    """
    scenes = sorted({look.image[0] for look in looks if look.image is not None})
    if len(scenes) > 1:
        raise InputError(
            f"the looks are of different scenes ({listed(scenes)}); fuse those of each scene alone",
            parameters=("looks",),
        )
    timed = [(i, look.time_s) for i, look in enumerate(looks) if look.time_s is not None]
    for (i, before), (j, after) in pairwise(timed):
        if not after > before:
            raise InputError(
                f"look {j} was at {after:g} s, and look {i} before it at {before:g} s: times "
                "should increase from look to look",
                parameters=("time_s", "looks"),
            )


@dataclass(frozen=True, eq=False)
class _Prepared:
    """Looks that have passed all checks, as results whose images are the looks' numbers."""

    looks: Sequence[Look]
    dataset: str
    models: Mapping[str, Models] | None
    sane: Mapping[str, Results]
    motion: CameraMotion | None
    notes: Sequence[str]

    def judged(self, name: str) -> Bool[ndarray, " n"]:
        """Return which of an estimator's rows are of the last look."""
        return np.asarray(self.sane[name].im_id == len(self.looks) - 1)

    def fused(
        self, principal: str, objects: set[int] | None, rules: ViewRules, spreads: Spreads
    ) -> FusedEstimates:
        """Fuse the principal's instances of some objects, or of all."""
        sane = dict(self.sane)
        if objects is not None:
            table = sane[principal]
            mine = np.isin(table.obj_id, list(objects)) | ~self.judged(principal)
            sane[principal] = table if mine.all() else table.select(mine)
        found = fuse_sane(
            sane,
            self.motion,
            rules,
            spreads,
            dataset=self.dataset,
            principal=principal,
            models=self.models,
            notes=self.notes,
        )
        return _renumbered(found, self.looks)


def _prepared(
    looks: Sequence[Look], dataset: str | None, models: Mapping[str, Models] | None
) -> _Prepared:
    _check_order(looks)
    dataset = _dataset(looks, dataset)
    names = list(dict.fromkeys(name for look in looks for name in look.results))
    results = {name: _joined(name, looks) for name in names}
    sane, notes = results, []
    if names:
        tables, _, left_out = sane_rows(results, dataset, models)
        sane, notes = dict(zip(names, tables, strict=True)), list(left_out)
        most = max(names, key=lambda name: len(sane[name]))
        if len(sane[most]) >= MIN_INSTANCES:
            check_estimators(sane, dataset, most, models)
    empty = [i for i, look in enumerate(looks) if not len(look)]
    notes += [f"no estimate in look {listed(empty)}"] if empty else []
    motion = _motion(looks)
    if motion is not None and len(looks) > 1:
        notes += filter(None, [check_looks(sane, motion, len(looks) - 1)])
    return _Prepared(looks, dataset, models, sane, motion, notes)


def _rules(
    looks: Sequence[Look], max_views: int, min_parallax_rad: float, noise: CameraNoise | None
) -> ViewRules:
    if not looks:
        raise InputError("there is no look to fuse", parameters=("looks",))
    if max_views != int(max_views):
        raise InputError(f"max_views should be a whole number, not {max_views}")
    last = frozenset({(0, len(looks) - 1)})
    noise = noise or CameraNoise()
    return ViewRules("earlier", int(max_views), float(min_parallax_rad), noise, last)


def _dataset(looks: Sequence[Look], given: str | None) -> str:
    """Return the dataset of all looks.

    Raises
    ------
    InputError
        If there is none, or more than one.
    """
    stated = {name for look in looks for name in look.datasets} | ({given} if given else set())
    if len(stated) > 1:
        raise InputError(
            f"the looks are of objects of different datasets: {', '.join(sorted(stated))}",
            parameters=("looks", "dataset"),
        )
    if not stated:
        raise InputError(
            "results do not state their dataset: give its name", parameters=("dataset",)
        )
    return stated.pop()


def _joined(name: str, looks: Sequence[Look]) -> Results:
    """Return an estimator's results of all looks, whose numbers are the images."""
    tables = [look.results.get(name) for look in looks]
    some = [table for table in tables if table is not None]
    im_id = [np.full(len(t), i) for i, t in enumerate(tables) if t is not None]
    images = np.concatenate(im_id)
    return Results(
        scene_id=np.zeros_like(images),
        im_id=images,
        obj_id=np.concatenate([table.obj_id for table in some]),
        score=np.concatenate([table.score for table in some]),
        cam_T_obj=np.concatenate([table.cam_T_obj for table in some]),
        time_s=np.concatenate([table.time_s for table in some]),
        line=np.concatenate([table.line for table in some]),
        source=some[-1].source,
    )


def _motion(looks: Sequence[Look]) -> CameraMotion | None:
    known = {(0, i): look.world_T_cam for i, look in enumerate(looks)}
    poses = {key: pose for key, pose in known.items() if pose is not None}
    return CameraMotion(poses, "the looks' camera poses") if poses else None


def _renumbered(found: FusedEstimates, looks: Sequence[Look]) -> FusedEstimates:
    """Return the fused estimates with the scene and images of the looks' results."""
    if all(look.image is None for look in looks):
        return found
    scene_id = next(look.image[0] for look in looks if look.image is not None)
    images = [i if look.image is None else look.image[1] for i, look in enumerate(looks)]
    keys, gathered = found.instances, found.gathered
    keys = replace(
        keys,
        scene_id=np.full_like(keys.scene_id, scene_id),
        im_id=np.full_like(keys.im_id, images[-1]),
    )
    views = gathered.view_im_id
    renumbered = np.where(views >= 0, np.array(images)[views], -1)
    return replace(
        found, instances=keys, gathered=replace(gathered, instances=keys, view_im_id=renumbered)
    )
