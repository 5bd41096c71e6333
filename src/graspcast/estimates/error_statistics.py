"""The shape of estimators' errors: their tails, and whether estimators fail together.

Consensus can warn of an error only where supporters do not make the same one, so what matters
beside a median is how long the tail is and how far errors of two estimators go together.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import polars as pl

from graspcast.errors import MismatchError

__all__ = ["MEASURED", "correlations", "tails"]

MEASURED = ("rotation_deg", "translation_mm", "ray_share")
"""The errors that a shape is of; cheap beside those over all vertices."""

# The true instance: est_id is each estimator's own.
_KEYS = ("scene_id", "im_id", "obj_id", "gt_id")
_QUANTILES = (0.5, 0.75, 0.95)
_LARGE_DEG, _FLIPPED_DEG, _LARGE_MM = 30.0, 90.0, 50.0


def tails(errors: pl.DataFrame) -> pl.DataFrame:
    """Compute quantiles of one estimator's errors, and shares of large ones, by object.

    Parameters
    ----------
    errors
        As from :func:`graspcast.estimates.error_tables.measure`, with :data:`MEASURED`.

    Returns
    -------
        A row for each object, and one (``obj_id`` null) of all instances alike: ``n``; 50, 75 and
        95 % quantiles of rotation and translation; the median share of the translation error that
        lies along the viewing ray; the shares of rotations off by more than 30° and 90°, and of
        translations off by more than 50 mm.
    """
    rotation, translation = pl.col("rotation_deg"), pl.col("translation_mm")
    columns = [
        pl.len().alias("n"),
        *(rotation.quantile(q, "linear").alias(f"rotation_deg_{100 * q:.0f}") for q in _QUANTILES),
        *(
            translation.quantile(q, "linear").alias(f"translation_mm_{100 * q:.0f}")
            for q in _QUANTILES
        ),
        pl.col("ray_share").fill_nan(None).median().alias("ray_share_50"),
        (rotation > _LARGE_DEG).mean().alias("over_30_deg"),
        (rotation > _FLIPPED_DEG).mean().alias("over_90_deg"),
        (translation > _LARGE_MM).mean().alias("over_50_mm"),
    ]
    by_object = errors.group_by("obj_id").agg(columns).sort("obj_id")
    overall = errors.select(pl.lit(None, pl.Int64).alias("obj_id"), *columns)
    return pl.concat([by_object, overall])


def correlations(errors: Mapping[str, pl.DataFrame]) -> pl.DataFrame:
    """Compute Spearman's rank correlation of errors between estimators, over common instances.

    Parameters
    ----------
    errors
        Each estimator's, as from :func:`graspcast.estimates.error_tables.measure`.

    Returns
    -------
        A row for each pair: ``first, second, n``, the correlations ``rotation`` and
        ``translation``, and ``both_large``: of the instances on which one of the two is off by more
        than 30° or 50 mm, the share on which the other is too (null if there is none).

    Raises
    ------
    MismatchError
        If two estimators have no instance in common.
    """
    large = (pl.col("rotation_deg") > _LARGE_DEG) | (pl.col("translation_mm") > _LARGE_MM)
    tables = {
        name: table.select(*_KEYS, "rotation_deg", "translation_mm", large.alias("large"))
        for name, table in errors.items()
    }
    rows = []
    for first, second in combinations(tables, 2):
        joined = tables[first].join(tables[second], on=_KEYS, suffix="_2")
        if not len(joined):
            raise MismatchError(f"{first} and {second} have no instance in common")
        both = int((joined["large"] & joined["large_2"]).sum())
        either = int((joined["large"] | joined["large_2"]).sum())
        rows.append(
            {
                "first": first,
                "second": second,
                "n": len(joined),
                "rotation": _spearman(joined, "rotation_deg"),
                "translation": _spearman(joined, "translation_mm"),
                "both_large": both / either if either else None,
            }
        )
    schema = {"first": pl.String, "second": pl.String, "n": pl.Int64}
    schema |= dict.fromkeys(("rotation", "translation", "both_large"), pl.Float64)
    return pl.DataFrame(rows, schema=schema)


def _spearman(joined: pl.DataFrame, measure: str) -> float | None:
    value = joined.select(pl.corr(measure, f"{measure}_2", method="spearman")).item()
    return None if value is None or value != value else float(value)
