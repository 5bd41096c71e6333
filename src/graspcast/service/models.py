"""Cards of the models that judge, as the service shows them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graspcast.runtime.watcher import Watcher

__all__ = ["models_of"]


def models_of(watcher: Watcher) -> dict[str, Any]:
    """Return what judges, and by which policy, as ``answers.ModelsOut`` describes it."""
    models = []
    for forecaster, policy in zip(watcher.forecasters, watcher.policies, strict=True):
        card = forecaster.card
        models.append(
            {
                "digest": card.digest,
                "principal": card.principal,
                "supporters": list(card.supporters),
                "gripper": card.gripper,
                "objects": {name: list(card.grasps_of(name)) for name in card.objects},
                "method": card.method,
                "views": bool(card.views),
                "samples": card.samples,
                "success_rate": card.success_rate,
                "warnings": list(card.warnings),
                "threshold": policy["threshold"],
                "guarantee": policy["guarantee"],
                "guide": policy["guide"],
                "max_looks": policy["max_looks"],
            }
        )
    return {
        "models": models,
        "estimators": list(watcher.estimators),
        "records": watcher.records,
    }
