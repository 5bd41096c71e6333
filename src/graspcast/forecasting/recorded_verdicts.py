"""Verdicts on recorded estimates of several datasets, with the views that each instance has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from graspcast.errors import MismatchError, UnknownNameError
from graspcast.estimates.instances import InstanceKey
from graspcast.estimates.loading import Inputs
from graspcast.forecasting.fallbacks import Fallbacks, certificate_of
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.look_again import MIN_GAIN
from graspcast.forecasting.novelty import OOD_ALPHA
from graspcast.forecasting.verdict import VerdictRow
from graspcast.forecasting.view_verdicts import BEST, FUSED
from graspcast.forecasting.visibility_features import seen_in_images
from graspcast.guarantees.certificate import Certificate
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from graspcast.views.choice import MIN_PARALLAX_RAD, ViewsFrom
from graspcast.views.fused_estimates import FusedEstimates, fuse_estimates

__all__ = ["ViewSettings", "fused_of", "judge_recorded", "verdicts_with_views"]


@dataclass(frozen=True)
class ViewSettings:
    """Which views serve, and who guides.

    Attributes
    ----------
    guide
        An estimator, ``fused`` or ``best``; None is the model's principal.
    max_views
        At most so many images an instance, its own included.
    views_from
        ``earlier`` images of the scene, or ``all``.
    min_parallax_rad
        Least angle between two views.
    noise
        Of the camera motion.
    max_looks, min_gain
        As for :meth:`Forecaster.judge`.
    """

    guide: str | None = None
    max_views: int = 3
    views_from: ViewsFrom = "earlier"
    min_parallax_rad: float = MIN_PARALLAX_RAD
    noise: CameraNoise = field(default_factory=CameraNoise)
    max_looks: int = 1
    min_gain: float = MIN_GAIN


def fused_of(
    forecaster: Forecaster,
    inputs: Inputs,
    dataset: str,
    motion: CameraMotion | None,
    settings: ViewSettings,
) -> FusedEstimates:
    """Fuse what a forecaster needs, of one dataset; the inputs' notes get what is left out."""
    card = forecaster.card
    tables = inputs.results[dataset]
    card.check_estimators(tables)
    principal = card.principal if settings.guide in (None, FUSED, BEST) else settings.guide
    fused = fuse_estimates(
        {name: tables[name] for name in card.estimators},
        motion,
        dataset=dataset,
        principal=principal,
        models=inputs.models,
        noise=settings.noise,
        views_from=settings.views_from,
        max_views=settings.max_views if motion is not None else 1,
        min_parallax_rad=settings.min_parallax_rad,
    )
    inputs.notes.extend(text for text in fused.notes if text not in inputs.notes)
    return fused


def judge_recorded(
    forecaster: Forecaster,
    inputs: Inputs,
    dataset: str,
    motion: CameraMotion | None,
    settings: ViewSettings,
    **options: Any,
) -> tuple[FusedEstimates, list[VerdictRow]]:
    """Fuse the instances of one dataset, and judge them; ``options`` are further ones of judge."""
    fused = fused_of(forecaster, inputs, dataset, motion, settings)
    if forecaster.visibility is not None and forecaster.visibility.uses_image:
        options["seen"] = seen_in_images(inputs, fused)
    rows = forecaster.judge(
        fused,
        inputs.models,
        guide=settings.guide,
        max_looks=settings.max_looks,
        min_gain=settings.min_gain,
        motion=motion,
        noise=settings.noise,
        **options,
    )
    return fused, rows


def verdicts_with_views(
    models: Fallbacks,
    inputs: Inputs,
    motions: Mapping[str, CameraMotion],
    settings: ViewSettings,
    *,
    threshold: float = 0.5,
    certificates: Sequence[Certificate] = (),
    ood_alpha: float = OOD_ALPHA,
) -> list[VerdictRow]:
    """Return a verdict on every instance of the principal's, ordered by key.

    Parameters
    ----------
    models
        Forecasters; where the first has no forecast, the next answers.
    inputs
        Estimates of any datasets; its notes get what is left out.
    motions
        Dataset's name to its camera motion; without it each image is judged alone.
    settings
        Which views serve, and who guides.
    threshold, certificates, ood_alpha
        As for :meth:`Fallbacks.verdict_rows`.

    Raises
    ------
    MismatchError
        If no model can be used, or none was trained with views and there is camera motion.
    UnknownNameError
        For a guide that is none of them.
    """
    usable = models.usable(inputs.estimators)
    known = (*usable[0].card.estimators, FUSED, BEST)
    if settings.guide is not None and settings.guide not in known:
        raise UnknownNameError("guide", settings.guide, known, parameters=("guide",))
    if motions and all(forecaster.view_model is None for forecaster in usable):
        raise MismatchError(
            "there are camera poses, but the model was trained without views: train it with "
            "camera poses too, or give none here",
            parameters=("model", "camera_poses"),
        )
    out: dict[InstanceKey, VerdictRow] = {}
    for forecaster in usable:
        least: float | None = threshold
        guarantee = None
        if certificates:
            overall = certificate_of(forecaster, certificates, ood_alpha).overall
            least, guarantee = overall.threshold, str(overall)
        for dataset in inputs.results:
            motion = motions.get(dataset)
            options = {"threshold": least, "guarantee": guarantee, "ood_alpha": ood_alpha}
            fused, rows = judge_recorded(forecaster, inputs, dataset, motion, settings, **options)
            for key, row in zip(fused.instances.to_keys(), rows, strict=True):
                if key not in out or out[key].verdict.probability is None:
                    out[key] = row
    return [out[key] for key in sorted(out)]
