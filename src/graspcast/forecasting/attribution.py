"""What moved a probability: the features in groups, each set to what is typical."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.forecasting.features import Features
from graspcast.forecasting.models.base import Predictor

__all__ = ["attributions", "groups_of"]

_TURNS = {"rot", "angle", "turn", "dpsi"}
_ALONE = {"view", "axis", "distance"}
"""The side from which the principal is seen: medians of it would be no side."""


def groups_of(names: Sequence[str]) -> dict[str, Int[ndarray, "c"]]:
    """Columns by what they say: a supporter's rotation or position, or two supporters' difference.

    Medians and means over all supporters go with every group of their kind.
    """
    groups: dict[str, list[int]] = {}
    common: dict[str, list[int]] = {"rotation": [], "position": []}
    for i, name in enumerate(names):
        stem, *others = name.split(".")
        kind, *rest = stem.split("_")
        if kind in _ALONE:
            continue
        if len(others) == 2:
            groups.setdefault(f"{others[0]} against {others[1]}", []).append(i)
        elif others:
            what = "rotation" if kind in _TURNS else "position"
            groups.setdefault(f"{what} by {others[0]}", []).append(i)
        else:
            common["rotation" if rest[:1] == ["turn"] else "position"].append(i)
    if not groups:
        groups["disagreement"] = []
    for group, columns in groups.items():
        for what, shared in common.items():
            if group.startswith(what) or group == "disagreement":
                columns.extend(shared)
    return {group: np.array(columns, dtype=np.int64) for group, columns in groups.items()}


def attributions(
    predictor: Predictor,
    features: Features,
    numbers: Int[ndarray, "n"],
    typical: Float[ndarray, "d"],
) -> list[tuple[tuple[str, float], ...]]:
    """For each row: the groups, and the probability less that with the group typical.

    The strongest come first.
    """
    groups = groups_of(features.names)
    stacked = np.tile(features.values, (len(groups) + 1, 1, 1))
    for i, columns in enumerate(groups.values()):
        stacked[i + 1][:, columns] = typical[columns]
    flat = stacked.reshape(-1, stacked.shape[-1])
    asked = predictor.probability(flat, np.tile(numbers, len(groups) + 1))
    found = asked.reshape(len(groups) + 1, -1)
    attribution = found[0] - found[1:]
    out = []
    for column in attribution.T:
        order = np.argsort(-np.abs(column), kind="stable")
        names = list(groups)
        out.append(tuple((names[i], float(column[i])) for i in order.tolist()))
    return out
