"""Which grasps a frame says can be reached: names that no model knows are refused."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from graspcast.errors import UnknownNameError
from graspcast.forecasting.model_card import ModelCard

__all__ = ["check_reachable"]


def check_reachable(
    reachable: Collection[str] | Mapping[str, Collection[str]], cards: Sequence[ModelCard]
) -> None:
    """Raise for objects and grasps that no model knows.

    Raises
    ------
    UnknownNameError
        Listing those that are known.
    """
    known: dict[str, set[str]] = {}
    for card in cards:
        for name in card.objects:
            known.setdefault(name, set()).update(card.grasps_of(name))
    if not isinstance(reachable, Mapping):
        _check(reachable, set().union(*known.values()), "reachable grasp")
        return
    _check(reachable, known, "reachable object")
    for name, grasps in reachable.items():
        _check(grasps, known[name], f"reachable grasp of {name}")


def _check(names: Collection[str], known: Collection[str], what: str) -> None:
    for name in names:
        if name not in known:
            raise UnknownNameError(what, name, sorted(known), parameters=("reachable",))
