"""Fusion in parts: the instances of a principal, and those of others that it lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.io.progress import Progress, step_of
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.choice import MIN_PARALLAX_RAD, ViewsFrom
from graspcast.views.fused_estimates import (
    FusedEstimates,
    checked_estimates,
    fuse_sane,
    view_rules,
)
from graspcast.views.motion import Motion
from graspcast.views.spread import Spreads

__all__ = ["fuse_estimates_by"]


def fuse_estimates_by(
    results: Mapping[str, Results],
    principals: Sequence[str],
    motion: Motion | None = None,
    *,
    dataset: str,
    models: Mapping[str, Models] | None = None,
    noise: CameraNoise | None = None,
    views_from: ViewsFrom = "earlier",
    max_views: int = 3,
    min_parallax_rad: float = MIN_PARALLAX_RAD,
    progress: Progress | None = None,
) -> list[FusedEstimates]:
    """Fuse estimates, each object in an image by the first principal that has an estimate of it.

    Parameters
    ----------
    results, motion, dataset, models, noise, views_from, max_views, min_parallax_rad
        As for :func:`~graspcast.views.fused_estimates.fuse_estimates`.
    principals
        Names, in the order in which they are preferred.
    progress
        Called with the share done, and the number of objects in images.

    Returns
    -------
        One for each principal that has instances.

    Raises
    ------
    InputError
        If none of them has an estimate.
    MismatchError
        As ``fuse_estimates``.
    """
    rules = view_rules(views_from, max_views, min_parallax_rad, noise)
    sane, notes = checked_estimates(results, motion, principals, dataset=dataset, models=models)
    done: frozenset[tuple[int, int, int]] = frozenset()
    steps: list[tuple[str, frozenset[tuple[int, int, int]]]] = []
    for name in principals:
        keys = _keys(sane[name])
        if keys - done:
            steps.append((name, done))
        done |= keys
    return [
        fuse_sane(
            sane,
            motion,
            replace(rules, without=others),
            Spreads(),
            dataset=dataset,
            principal=name,
            models=models,
            notes=notes,
            progress=step_of(progress, i, len(steps)),
        )
        for i, (name, others) in enumerate(steps)
    ]


def _keys(table: Results) -> frozenset[tuple[int, int, int]]:
    """Return the objects in images of which there are estimates."""
    columns = table.scene_id.tolist(), table.im_id.tolist(), table.obj_id.tolist()
    return frozenset(zip(*columns, strict=True))
