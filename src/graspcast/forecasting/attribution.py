"""Attribution of a forecast to groups of features.

The attribution of a group is the forecast less the forecast with the group's features set to their
medians in training (an ablation to a baseline).
"""

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
"""The viewing direction of the principal, whose median would be no direction."""
_OF_ONE = {"score": "its score", "fit": "image fit", "image": "place in the image"}
"""What a single view of one estimator is judged by, by the first word of the column."""


def groups_of(names: Sequence[str]) -> dict[str, Int[ndarray, " c"]]:
    """Group feature columns: a supporter's rotation or position, or two supporters' difference.

    Medians and means over all supporters belong to every group of their kind. What a single view
    of one estimator is judged by has groups of its own.
    """
    groups: dict[str, list[int]] = {}
    common: dict[str, list[int]] = {"rotation": [], "position": []}
    for i, name in enumerate(names):
        stem, *others = name.split(".")
        kind, *rest = stem.split("_")
        if kind in _ALONE:
            continue
        if kind in _OF_ONE:
            groups.setdefault(_OF_ONE[kind], []).append(i)
        elif len(others) == 2:
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
    numbers: Int[ndarray, " n"],
    typical: Float[ndarray, " d"],
) -> list[tuple[tuple[str, float], ...]]:
    """Attribute each row's forecast to groups of features.

    Parameters
    ----------
    predictor
        The model.
    features
        Features of n instances.
    numbers
        Their object numbers, (n,).
    typical
        Medians of the training features, (d,).

    Returns
    -------
        For each row pairs of a group's name and its attribution, the largest magnitude first.
    """
    groups = groups_of(features.names)
    stacked = np.tile(features.values, (len(groups) + 1, 1, 1))
    for i, columns in enumerate(groups.values()):
        # What is not known stays so: else another part of the model would answer.
        known = ~np.isnan(features.values[:, columns])
        stacked[i + 1][:, columns] = np.where(known, typical[columns], np.nan)
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
