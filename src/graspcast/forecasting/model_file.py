"""Model file: card, predictor, novelty detector and typical features of each guide, in one npz.

It holds arrays and JSON, without pickle, and carries a digest.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import FormatError
from graspcast.forecasting.known_objects import KnownObjects
from graspcast.forecasting.model_card import ONE_VIEW_FEATURES, ModelCard
from graspcast.forecasting.models.add_threshold import Thresholds
from graspcast.forecasting.models.base import Predictor
from graspcast.forecasting.models.blend import Blend, visibility_of
from graspcast.forecasting.models.mlp.ensemble import NetworkEnsemble
from graspcast.forecasting.models.visibility import Visibility
from graspcast.forecasting.novelty import Novelty
from graspcast.io.arrays import read_arrays, write_arrays
from graspcast.views.statistics import STATISTICS

__all__ = ["KINDS", "Parts", "read_model", "write_model"]

KINDS: Mapping[str, Any] = {
    "blend": Blend,
    "two-stage": Blend,
    "direct": Blend,
    "threshold": Thresholds,
    "MLP": NetworkEnsemble,
    "MLP-O": NetworkEnsemble,
    "visibility": Visibility,
}
"""Method's name to the class of its model."""
_FORMAT = 5
_REMEDY = "train it again"


Parts = tuple[ModelCard, Predictor, Novelty | None, Float[ndarray, " d"]]
"""What a forecaster is made of, for one guide."""


def write_model(
    path: str | PathLike[str], parts: Sequence[Parts], known: KnownObjects | None = None
) -> None:
    """Write the parts of a forecaster, the principal's first, then those of other guides.

    Parameters
    ----------
    path
        The file.
    parts
        Of each guide.
    known
        What the file carries of the objects.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    cards = [card.as_dict() for card, *_ in parts]
    content = {"format": _FORMAT, "card": cards[0], "others": cards[1:]}
    arrays = {"card": np.array(json.dumps(content))}
    for i, (_, predictor, novelty, typical) in enumerate(parts):
        arrays[f"{i}/typical"] = typical
        if i and isinstance(predictor, Blend):
            mine = predictor.to_arrays(shared=False)
        else:
            mine = predictor.to_arrays()
        arrays |= _prefixed(f"{i}/predictor", mine)
        if novelty is not None:
            arrays |= _prefixed(f"{i}/novelty", novelty.to_arrays())
    if known is not None:
        arrays |= _prefixed("objects", known.to_arrays())
    write_arrays(path, arrays)


def read_model(path: str | PathLike[str]) -> tuple[list[Parts], KnownObjects | None]:
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
        cards = [ModelCard.from_dict(card) for card in (content["card"], *content["others"])]
        if len({card.principal for card in cards}) != len(cards):
            raise ValueError("two parts are for one guide")
        out: list[Parts] = []
        for i, card in enumerate(cards):
            out.append(_part(card, _below(str(i), arrays), out[0][1] if out else None))
        objects = _below("objects", arrays)
        known = KnownObjects.from_arrays(objects) if objects else None
    except FormatError:
        raise
    except Exception as error:  # those of the parts' checks, of JSON and of NumPy have no base
        raise FormatError(path, f"is not a complete model file ({error}); {_REMEDY}") from error
    return out, known


def _part(card: ModelCard, arrays: Mapping[str, ndarray], shared: Predictor | None) -> Parts:
    """Restore the parts of one guide; raise a ValueError if they are wrong."""
    below = _below("predictor", arrays)
    predictor: Predictor
    if KINDS[card.method] is Blend:
        predictor = Blend.from_arrays(below, shared if isinstance(shared, Blend) else None)
    else:
        predictor = KINDS[card.method].from_arrays(below)
    one_view = visibility_of(predictor)
    if (card.features == ONE_VIEW_FEATURES) != (one_view is not None):
        raise ValueError("the card and the model disagree on forecasts from one view")
    compared = bool(card.supporters) or one_view is not None
    novelty = Novelty.from_arrays(_below("novelty", arrays)) if compared else None
    typical = arrays["typical"]
    if typical.ndim != 1 or typical.dtype != np.float64 or not np.isfinite(typical).all():
        raise ValueError("the typical features are not a list of finite numbers")
    if novelty is not None and novelty.centre.size != 6 * len(card.supporters):
        raise ValueError(f"{novelty.centre.size} entries for {len(card.supporters)} supporters")
    count = len(card.targets)
    if isinstance(predictor, Blend) and len(predictor.tried) != count:
        raise ValueError(f"{len(predictor.tried)} objects, or grasps of them, of {count}")
    if card.grasps and isinstance(predictor, Thresholds | NetworkEnsemble):
        raise ValueError(f"the method {card.method} knows one grasp of each object")
    if one_view is not None:
        _check_one_view(one_view, typical, count)
    elif novelty is not None:
        tried = predictor.probability(np.tile(typical, (count, 1)), np.arange(count))
        if tried.shape != (count,) or not ((tried >= 0) & (tried <= 1)).all():
            raise ValueError("it forecasts other than probabilities")
    if isinstance(predictor, Blend) and predictor.views is not None:
        _check_views(predictor, count)
    return card, predictor, novelty, typical


def _check_one_view(visibility: Visibility, typical: Float[ndarray, " d"], count: int) -> None:
    """Raise a ValueError unless a visibility model forecasts probabilities."""
    if len(visibility.tried) != count or typical.shape != (len(visibility.names),):
        raise ValueError("the model of one view knows other objects, or has other columns")
    numbers = np.flatnonzero(visibility.tried)
    tried = visibility.probability(np.tile(typical, (len(numbers), 1)), numbers)
    if not ((tried >= 0) & (tried <= 1)).all():
        raise ValueError("the model of one view forecasts other than probabilities")


def _check_views(predictor: Blend, count: int) -> None:
    """Raise a ValueError unless the view model forecasts probabilities."""
    pose = np.tile(np.eye(4), (count, 1, 1))
    pose[:, 2, 3] = 1.0
    statistics = np.zeros((count, len(STATISTICS)))
    tried = predictor.view_probability(statistics, pose, pose, np.arange(count))
    known = tried[predictor.known]
    if not ((known >= 0) & (known <= 1)).all():
        raise ValueError("the view model forecasts other than probabilities")


def _prefixed(prefix: str, arrays: Mapping[str, ndarray]) -> dict[str, ndarray]:
    return {f"{prefix}/{name}": array for name, array in arrays.items()}


def _below(prefix: str, arrays: Mapping[str, ndarray]) -> dict[str, ndarray]:
    return {
        name.removeprefix(f"{prefix}/"): array
        for name, array in arrays.items()
        if name.startswith(f"{prefix}/")
    }
