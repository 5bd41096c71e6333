"""Certificates tried on held-out data: certified on one half of the units, applied to the other."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.forecasting.view_verdicts import FUSED
from graspcast.guarantees.certify import certify

__all__ = ["best_guides", "certify_views", "resample_certificates"]


def resample_certificates(
    probability: Float[ndarray, " n"],
    success: Bool[ndarray, " n"],
    units: ndarray,
    *,
    rate: float = 0.9,
    confidence: float = 0.9,
    resamplings: int = 200,
    seed: int = 0,
) -> dict[str, float]:
    """Certify on a random half of the units and attempt the other half, many times.

    Parameters
    ----------
    probability, success, units
        Forecasts that were made without the units' own outcomes, outcomes, and units.
    rate, confidence
        Of the guarantee.
    resamplings
        How many times.
    seed
        Of the halves, and of the certificates.

    Returns
    -------
        Shares of the resamplings in which no threshold was found (``none``) and in which attempts
        succeeded at less than the rate (``false``); mean share that was ``attempted``, also
        relative to that of a perfect ranking (``of_perfect``), which attempts all successes and
        then failures until the rate is just reached; and the mean ``success`` rate of the attempts.
    """
    random = np.random.default_rng(seed)
    names = np.unique(units)
    found: dict[str, list[float]] = {k: [] for k in ("none", "false", "attempted", "of_perfect")}
    rates = []
    for _ in range(resamplings):
        half = np.isin(units, random.permutation(names)[: len(names) // 2])
        threshold = certify(
            probability[half],
            success[half],
            units[half],
            rate=rate,
            confidence=confidence,
            seed=seed,
        ).overall.threshold
        others, outcomes = probability[~half], success[~half]
        attempts = others >= (np.inf if threshold is None else threshold)
        if attempts.any():
            rates.append(float(outcomes[attempts].mean()))
        found["none"].append(threshold is None)
        found["false"].append(bool(attempts.any()) and outcomes[attempts].mean() < rate)
        found["attempted"].append(float(attempts.mean()))
        found["of_perfect"].append(float(attempts.mean() / min(1.0, outcomes.mean() / rate)))
    out = {name: float(np.mean(values)) for name, values in found.items()}
    return {**out, "success": float(np.mean(rates)) if rates else float("nan")}


def best_guides(mine: pl.DataFrame, column: str) -> pl.DataFrame:
    """Choose for each instance the guide whose forecast is highest.

    Parameters
    ----------
    mine
        Forecasts of some guides with outcomes, one row for each instance and guide.
    column
        Of the forecasts.
    """
    ordered = mine.sort(column, "principal", descending=[True, False], maintain_order=True)
    return ordered.unique("instance", keep="first", maintain_order=True).sort("instance")


def certify_views(found: pl.DataFrame, *, views: int = 3, **options: Any) -> list[dict[str, Any]]:
    """Certify forecasts from one view and from several, with images as units.

    Parameters
    ----------
    found
        As :func:`graspcast.evaluation.view_table.forecast_with_views` returns it.
    views
        At most so many.
    options
        Of :func:`resample_certificates`.

    Returns
    -------
        One entry for each gripper, guide (each principal, and ``best``, whichever has the highest
        forecast for the instance) and ``views``.
    """
    rows = found.filter(
        pl.col("row") == f"{views} views", pl.col("principal") != FUSED, pl.col("alone") == ""
    )
    out = []
    for gripper in rows["gripper"].unique(maintain_order=True).to_list():
        mine = rows.filter(pl.col("gripper") == gripper)
        names = mine["principal"].unique(maintain_order=True).to_list()
        for count, column in ((1, "one_view"), (views, "probability")):
            guides = {name: mine.filter(pl.col("principal") == name) for name in names}
            for guide, part in {**guides, "best": best_guides(mine, column)}.items():
                tried = resample_certificates(
                    part[column].to_numpy(),
                    part["success"].to_numpy().astype(bool),
                    part["image"].to_numpy().astype(str),
                    **options,
                )
                entry = {"gripper": gripper, "guide": guide, "views": count, "n": len(part)}
                out.append({**entry, **tried})
    return out
