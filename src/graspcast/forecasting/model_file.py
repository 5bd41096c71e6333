"""Model file: the card, the predictor, the novelty detector and the typical features, in one npz.

It holds arrays and JSON, without pickle, and carries a digest.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import FormatError
from graspcast.forecasting.model_card import ModelCard
from graspcast.forecasting.models.add_threshold import Thresholds
from graspcast.forecasting.models.base import Predictor
from graspcast.forecasting.models.blend import Blend
from graspcast.forecasting.models.mlp.ensemble import NetworkEnsemble
from graspcast.forecasting.novelty import Novelty
from graspcast.io.arrays import read_arrays, write_arrays

__all__ = ["KINDS", "read_model", "write_model"]

KINDS: Mapping[str, Any] = {
    "blend": Blend,
    "two-stage": Blend,
    "direct": Blend,
    "threshold": Thresholds,
    "MLP": NetworkEnsemble,
    "MLP-O": NetworkEnsemble,
}
"""Method's name to the class of its model."""
_FORMAT = 4
_REMEDY = "train it again"


def write_model(
    path: str | PathLike[str],
    card: ModelCard,
    predictor: Predictor,
    novelty: Novelty,
    typical: Float[ndarray, " d"],
) -> None:
    """Write the parts of a forecaster.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    arrays = {
        "card": np.array(json.dumps({"format": _FORMAT, "card": card.as_dict()})),
        "typical": typical,
        **_prefixed("predictor", predictor.to_arrays()),
        **_prefixed("novelty", novelty.to_arrays()),
    }
    write_arrays(path, arrays)


def read_model(
    path: str | PathLike[str],
) -> tuple[ModelCard, Predictor, Novelty, Float[ndarray, " d"]]:
    """Read what :func:`write_model` wrote.

    Raises
    ------
    FormatError
        If the file is missing, damaged, of another format, or not a model.
    """
    arrays = read_arrays(path, _REMEDY)
    try:
        content = json.loads(str(arrays.pop("card")))
        if content["format"] != _FORMAT:
            raise FormatError(path, f"is a model of format {content['format']}, not {_FORMAT}")
        card = ModelCard.from_dict(content["card"])
        predictor = KINDS[card.method].from_arrays(_below("predictor", arrays))
        novelty = Novelty.from_arrays(_below("novelty", arrays))
        typical = arrays["typical"]
        if typical.ndim != 1 or typical.dtype != np.float64 or not np.isfinite(typical).all():
            raise ValueError("the typical features are not a list of finite numbers")
        if novelty.centre.size != 6 * len(card.supporters):
            raise ValueError(f"{novelty.centre.size} entries for {len(card.supporters)} supporters")
        count = len(card.objects)
        tried = predictor.probability(np.tile(typical, (count, 1)), np.arange(count))
        if tried.shape != (count,) or not ((tried >= 0) & (tried <= 1)).all():
            raise ValueError("it forecasts other than probabilities")
    except FormatError:
        raise
    except Exception as error:  # those of the parts' checks, of JSON and of NumPy have no base
        raise FormatError(path, f"is not a complete model file ({error}); {_REMEDY}") from error
    return card, predictor, novelty, typical


def _prefixed(prefix: str, arrays: Mapping[str, ndarray]) -> dict[str, ndarray]:
    return {f"{prefix}/{name}": array for name, array in arrays.items()}


def _below(prefix: str, arrays: Mapping[str, ndarray]) -> dict[str, ndarray]:
    return {
        name.removeprefix(f"{prefix}/"): array
        for name, array in arrays.items()
        if name.startswith(f"{prefix}/")
    }
