"""What episodes decide by: threshold, guide, looks and views, chosen or as certified."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from graspcast.errors import InputError, UnknownNameError
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.recorded_verdicts import ViewSettings, policy_of
from graspcast.forecasting.verdict import check_threshold
from graspcast.forecasting.view_verdicts import BEST, FUSED
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.look_policy import LookPolicy
from graspcast.views.camera_motion import CameraNoise

__all__ = ["decision_options"]


def decision_options(
    forecaster: Forecaster,
    *,
    threshold: float | None,
    guide: str | None,
    max_looks: int,
    max_views: int,
    min_gain: float,
    noise: CameraNoise | None,
    ood_alpha: float,
    guarantee: str | None,
    certificate: Certificate | None,
) -> dict[str, Any]:
    """Return the options of :meth:`Forecaster.judge` for each look.

    Raises
    ------
    InputError
        For a threshold that is no probability, looks that are no whole number, and a threshold or
        guarantee beside a certificate.
    MismatchError
        If the certificate is of another forecaster or policy.
    UnknownNameError
        For a guide that the forecaster does not know.
    """
    guide = forecaster.card.principal if guide is None else guide
    if guide not in (known := (*forecaster.guides, FUSED, BEST)):
        raise UnknownNameError("guide", guide, known, parameters=("guide",))
    if max_looks != int(max_looks) or max_views != int(max_views):
        raise InputError("Episode: max_looks and max_views should be whole numbers")
    least: float | None = 0.5 if threshold is None else check_threshold(threshold)
    if certificate is not None:
        if threshold is not None or guarantee is not None:
            raise InputError(
                "a certificate has its own threshold and guarantee: leave them out",
                parameters=("certificate", "threshold", "guarantee"),
            )
        settings = ViewSettings(
            guide=guide,
            max_views=int(max_views),
            noise=noise or CameraNoise(),
            max_looks=int(max_looks),
            min_gain=min_gain,
        )
        policy = _policy(forecaster, settings, certificate.policy)
        certificate.check_belongs_to(forecaster.card.digest, ood_alpha, policy)
        overall = certificate.overall
        least, guarantee = overall.threshold, str(overall)
    return {
        "guide": guide,
        "threshold": least,
        "guarantee": guarantee,
        "ood_alpha": ood_alpha,
        "min_gain": min_gain,
        "noise": noise,
    }


def _policy(
    forecaster: Forecaster, settings: ViewSettings, certified: LookPolicy | None
) -> LookPolicy | None:
    """Return the policy of episodes; which recorded images served is not theirs to choose."""
    most = settings.max_views
    views = forecaster.view_model is not None and max(most, settings.max_looks) > 1
    policy = policy_of(forecaster, settings, views=views)
    if policy is None:
        return None
    if settings.max_looks > 1:
        policy = replace(policy, max_views=min(most, settings.max_looks))
    return policy if certified is None else replace(policy, views_from=certified.views_from)
