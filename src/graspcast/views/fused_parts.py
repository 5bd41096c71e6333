"""Fusion in parts: the instances of a principal, and those of others that it lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from graspcast.bop.models import Models
from graspcast.bop.results import Results
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
) -> list[FusedEstimates]:
    """Fuse estimates, each object in an image by the first principal that has an estimate of it.

    Parameters
    ----------
    results, motion, dataset, models, noise, views_from, max_views, min_parallax_rad
        As for :func:`~graspcast.views.fused_estimates.fuse_estimates`.
    principals
        Names, in the order in which they are preferred.

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
    out = []
    for name in principals:
        keys = _keys(sane[name])
        if keys - done:
            part = fuse_sane(
                sane,
                motion,
                replace(rules, without=done),
                Spreads(),
                dataset=dataset,
                principal=name,
                models=models,
                notes=notes,
            )
            out.append(part)
        done |= keys
    return out


def _keys(table: Results) -> frozenset[tuple[int, int, int]]:
    """Return the objects in images of which there are estimates."""
    columns = table.scene_id.tolist(), table.im_id.tolist(), table.obj_id.tolist()
    return frozenset(zip(*columns, strict=True))
