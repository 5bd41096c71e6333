"""Cards of the models that judge, as the service shows them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graspcast.runtime.watcher import Watcher

__all__ = ["models_of"]


def models_of(watcher: Watcher) -> dict[str, Any]:
    """Return what judges and by which threshold, as :class:`~answers.ModelsOut` describes it."""
    return {"models": []}
