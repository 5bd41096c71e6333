"""Verdicts on recorded estimates of a dataset, with the views that each instance has."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import degrees
from typing import Any

from graspcast.errors import MismatchError, UnknownNameError
from graspcast.estimates.loading import Inputs
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.look_again import MIN_GAIN
from graspcast.forecasting.verdict import VerdictRow
from graspcast.forecasting.view_verdicts import BEST, FUSED
from graspcast.forecasting.visibility_features import seen_in_images
from graspcast.guarantees.look_policy import LookPolicy
from graspcast.io.progress import Progress, step_of
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from graspcast.views.choice import MIN_PARALLAX_RAD, ViewsFrom
from graspcast.views.fused_estimates import FusedEstimates
from graspcast.views.fused_parts import fuse_estimates_by

__all__ = [
    "ViewSettings",
    "check_views",
    "fused_of",
    "guides_of",
    "judge_recorded",
    "one_view_notes",
    "policy_of",
]


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
    others
        Whether to judge also the instances of other estimators that the principal lacks, where the
        fused pose may guide.
    """

    guide: str | None = None
    max_views: int = 3
    views_from: ViewsFrom = "earlier"
    min_parallax_rad: float = MIN_PARALLAX_RAD
    noise: CameraNoise = field(default_factory=CameraNoise)
    max_looks: int = 1
    min_gain: float = MIN_GAIN
    others: bool = False


def fused_of(
    forecaster: Forecaster,
    inputs: Inputs,
    dataset: str,
    motion: CameraMotion | None,
    settings: ViewSettings,
    progress: Progress | None = None,
) -> list[FusedEstimates]:
    """Fuse what a forecaster needs, of one dataset; the inputs' notes get what is left out.

    Returns
    -------
        The principal's instances, and where ``settings.others`` asks for them and there is camera
        motion, those of each other estimator that it lacks.
    """
    card = forecaster.card
    tables = inputs.results[dataset]
    card.check_estimators(tables)
    may_fuse = settings.guide in (FUSED, BEST)
    principal = card.principal if settings.guide is None or may_fuse else settings.guide
    others = [name for name in card.estimators if name != principal]
    found = fuse_estimates_by(
        {name: tables[name] for name in card.estimators},
        [principal, *(others if settings.others and may_fuse and motion is not None else ())],
        motion,
        dataset=dataset,
        models=inputs.models,
        noise=settings.noise,
        views_from=settings.views_from,
        max_views=settings.max_views if motion is not None else 1,
        min_parallax_rad=settings.min_parallax_rad,
        progress=progress,
    )
    inputs.add_notes(text for part in found for text in part.notes)
    return found


def judge_recorded(
    forecaster: Forecaster,
    inputs: Inputs,
    dataset: str,
    motion: CameraMotion | None,
    settings: ViewSettings,
    *,
    progress: Progress | None = None,
    **options: Any,
) -> list[tuple[FusedEstimates, list[VerdictRow]]]:
    """Fuse the instances of one dataset, and judge them; ``options`` are further ones of judge."""
    uses_image = forecaster.visibility is not None and forecaster.visibility.uses_image
    out = []
    # About as long as fusing takes judging.
    fusing = step_of(progress, 0, 2)
    for fused in fused_of(forecaster, inputs, dataset, motion, settings, fusing):
        seen: dict[str, Any] = {"seen": seen_in_images(inputs, fused)} if uses_image else {}
        rows = forecaster.judge(
            fused,
            inputs.models,
            guide=settings.guide,
            max_looks=settings.max_looks,
            min_gain=settings.min_gain,
            motion=motion,
            noise=settings.noise,
            **seen,
            **options,
        )
        out.append((fused, rows))
    return out


def policy_of(forecaster: Forecaster, settings: ViewSettings, *, views: bool) -> LookPolicy | None:
    """Return the policy of a certificate; None for the principal's one view.

    Parameters
    ----------
    forecaster
        Whose verdicts are meant.
    settings
        Which views serve, and who guides. With several looks, a verdict has as many views as looks.
    views
        Whether there is camera motion.
    """
    principal = forecaster.card.principal
    guide = principal if settings.guide is None else settings.guide
    looks = settings.max_looks
    if not views and looks == 1:
        if guide in (principal, FUSED):  # From one view, the principal guides instead.
            return None
        settings = ViewSettings(max_views=1)
    return LookPolicy(
        guide=guide,
        views=views,
        max_looks=looks,
        max_views=looks if looks > 1 else settings.max_views,
        views_from=settings.views_from,
        min_parallax_deg=round(degrees(settings.min_parallax_rad), 6),
        translation_sd_m=settings.noise.translation_m,
        rotation_sd_rad=settings.noise.rotation_rad,
        min_gain=settings.min_gain,
    )


def guides_of(forecaster: Forecaster, policy: LookPolicy | None) -> list[str]:
    """Return all names of estimators and fused poses that guide attempts under a policy.

    Episodes call every fused pose ``fused``, runs over recorded images ``fused2`` and so on.
    """
    if policy is None or policy.guide not in (FUSED, BEST):
        return [forecaster.card.principal if policy is None else policy.guide]
    fused = [FUSED, *(f"{FUSED}{looks}" for looks in range(2, policy.max_looks + 1))]
    fused = fused if policy.views else []
    if policy.guide == FUSED:
        return [forecaster.card.principal, *fused]
    return [*(forecaster.card.estimators if policy.views else forecaster.guides), *fused]


def check_views(
    forecasters: Iterable[Forecaster],
    settings: ViewSettings,
    motions: Mapping[str, CameraMotion],
) -> None:
    """Check that forecasters know the guide, and that one was trained with views if they serve.

    Raises
    ------
    MismatchError
        If there is camera motion and none was trained with views.
    UnknownNameError
        For a guide that is none of those of the first.
    """
    given = list(forecasters)
    known = (*given[0].card.estimators, FUSED, BEST)
    if settings.guide is not None and settings.guide not in known:
        raise UnknownNameError("guide", settings.guide, known, parameters=("guide",))
    if motions and all(forecaster.view_model is None for forecaster in given):
        raise MismatchError(
            "there are camera poses, but the model was trained without views: train it with "
            "camera poses too, or give none here",
            parameters=("model", "camera_poses"),
        )


def one_view_notes(
    forecasters: Iterable[Forecaster], guide: str | None, *, views: bool
) -> list[str]:
    """Say where each image is judged alone though several views were asked for or trained with.

    Parameters
    ----------
    forecasters
        Those that judge.
    guide
        Whose pose guides the grasps.
    views
        Whether there is camera motion.
    """
    if views:
        return []
    if any(forecaster.view_model is not None for forecaster in forecasters):
        why = "the model was trained with several views, but there are no camera poses"
    elif guide == FUSED:
        why = "the model was trained without views"
    else:
        return []
    instead = "; its principal guides instead of the fused pose" if guide == FUSED else ""
    return [f"{why}: each image is judged alone{instead}"]
