"""Settings of a visibility model."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["VisibilitySettings"]


@dataclass(frozen=True)
class VisibilitySettings:
    """Settings of a visibility model.

    Attributes
    ----------
    trees
        Trees of each forest.
    min_samples_leaf
        Outcomes in each leaf, at least.
    max_features
        Share of the columns that each split chooses from.
    folds
        Folds of the scenes (or blocks of frames) for out-of-fold predictions, by which forecasts
        are calibrated; 0 for no calibration.
    seed
        Of everything random.
    """

    trees: int = 128
    min_samples_leaf: int = 3
    max_features: float = 0.5
    folds: int = 4
    seed: int = 0
