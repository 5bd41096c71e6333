"""Contradictions: instances that are not attempted, as other views contradict the judged image."""

from __future__ import annotations

import numpy as np

from graspcast.views.fused_estimates import FusedEstimates

__all__ = ["CONTRADICTED", "MOVED", "single_view_doubts"]

MOVED = (
    "the other views contradict the judged image: its estimates are wrong, or the object was moved"
)
"""Why nothing is forecast where the judged image's estimates were dropped."""
CONTRADICTED = "another view contradicts the judged image, and no third decides which is wrong"
"""Why nothing is forecast from the judged image alone where all other views were dropped."""


def single_view_doubts(fused: FusedEstimates) -> list[str]:
    """Say for each instance why its judged image alone is not to be trusted, or nothing.

    Nothing is said where no other view contradicts the judged image, or one agrees with it.
    """
    used = np.asarray(fused.poses.used.any(axis=2))
    dropped = np.asarray(fused.poses.dropped.any(axis=2)) & ~used
    alone = dropped[:, 1:].any(axis=1) & ~used[:, 1:].any(axis=1)
    said = np.where(used[:, 0], np.where(alone, CONTRADICTED, ""), MOVED)
    return [str(text) for text in said.tolist()]
