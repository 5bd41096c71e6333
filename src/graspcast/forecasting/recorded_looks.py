"""Verdicts by several models on recorded estimates: with the views there are, or look by look."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import InstanceKey
from graspcast.estimates.loading import Inputs
from graspcast.forecasting.contradictions import CONTRADICTED, MOVED
from graspcast.forecasting.fallbacks import Fallbacks, certificate_of
from graspcast.forecasting.grasp_ranking import Reachable, refuse_mask
from graspcast.forecasting.looking import PolicyRun, run_at_once, run_policy
from graspcast.forecasting.novelty import OOD_ALPHA
from graspcast.forecasting.recorded_verdicts import ViewSettings, check_views, policy_of
from graspcast.forecasting.verdict import InstanceLooks, VerdictRow
from graspcast.guarantees.certificate import Certificate
from graspcast.io.progress import Progress, step_of
from graspcast.views.camera_motion import CameraMotion

__all__ = ["check_motions", "looks_with_views", "verdicts_with_views"]


def verdicts_with_views(
    models: Fallbacks,
    inputs: Inputs,
    motions: Mapping[str, CameraMotion],
    settings: ViewSettings,
    *,
    threshold: float = 0.5,
    certificates: Sequence[Certificate] = (),
    ood_alpha: float = OOD_ALPHA,
    reachable: Reachable | None = None,
    progress: Progress | None = None,
) -> list[VerdictRow]:
    """Return a verdict on every instance of the principal's, ordered by key.

    It rests on the views that there are, and says whether to look again. With certificates of a
    policy of several looks, it is the verdict at which that policy ended.

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
    threshold, certificates, ood_alpha, reachable
        As for :meth:`Fallbacks.verdict_rows`.
    progress
        Called with the share done and a short message.

    Raises
    ------
    MismatchError
        If no model can be used, none was trained with views and there is camera motion, or a
        certificate is of another policy.
    UnknownNameError
        For a guide that is none of them.
    """
    found = _by_instance(
        run_policy if certificates and settings.max_looks > 1 else run_at_once,
        models,
        inputs,
        motions,
        settings,
        threshold=threshold,
        certificates=certificates,
        ood_alpha=ood_alpha,
        reachable=reachable,
        progress=progress,
    )
    return [looks.last for looks in found]


def looks_with_views(
    models: Fallbacks,
    inputs: Inputs,
    motions: Mapping[str, CameraMotion],
    settings: ViewSettings,
    **options: Any,
) -> list[InstanceLooks]:
    """Return the verdicts after each look on every instance of the principal's, ordered by key.

    Parameters
    ----------
    models, inputs, motions, settings
        As for :func:`verdicts_with_views`.
    options
        Further ones of it.

    Raises
    ------
    InputError
        If there is one look alone.
    MismatchError, UnknownNameError
        As :func:`verdicts_with_views`, and where there is no camera motion.
    """
    if settings.max_looks < 2:
        raise InputError(
            "verdicts after each look take two looks or more", parameters=("max_looks",)
        )
    return _by_instance(run_policy, models, inputs, motions, settings, **options)


def check_motions(inputs: Inputs, motions: Mapping[str, CameraMotion]) -> None:
    """Check that there is camera motion of all datasets, or of none.

    Raises
    ------
    MismatchError
        Naming the datasets that have none.
    """
    missing = [dataset for dataset in inputs.results if dataset not in motions]
    if motions and missing:
        raise MismatchError(
            f"there are camera poses of {', '.join(motions)}, but not of {', '.join(missing)}: "
            "give them too, or the estimates of one dataset at a time",
            parameters=("camera_poses",),
        )


def _by_instance(
    run: Callable[..., PolicyRun],
    models: Fallbacks,
    inputs: Inputs,
    motions: Mapping[str, CameraMotion],
    settings: ViewSettings,
    *,
    threshold: float = 0.5,
    certificates: Sequence[Certificate] = (),
    ood_alpha: float = OOD_ALPHA,
    reachable: Reachable | None = None,
    progress: Progress | None = None,
) -> list[InstanceLooks]:
    """Judge by each model in turn; where one has no forecast, the next answers."""
    usable = models.usable(inputs.estimators)
    check_views(usable, settings, motions)
    if certificates or run is run_policy:
        check_motions(inputs, motions)
    # What is certified is certified for the principal's instances.
    settings = replace(settings, others=not certificates)
    out: dict[InstanceKey, InstanceLooks] = {}
    for i, forecaster in enumerate(usable):
        options: dict[str, Any] = {"threshold": threshold, "ood_alpha": ood_alpha}
        options["reachable"] = reachable
        if certificates:
            refuse_mask(reachable)
            policy = policy_of(forecaster, settings, views=bool(motions))
            overall = certificate_of(forecaster, certificates, ood_alpha, policy).overall
            options |= {"threshold": overall.threshold, "guarantee": str(overall)}
        for k, dataset in enumerate(inputs.results):
            number, steps = i * len(inputs.results) + k, len(usable) * len(inputs.results)
            options["progress"] = step_of(progress, number, steps)
            found = run(forecaster, inputs, dataset, motions.get(dataset), settings, **options)
            for key, looks in zip(found.instances.to_keys(), found.each, strict=True):
                if key not in out or _unanswered(out[key].last):
                    out[key] = looks
    return [out[key] for key in sorted(out)]


def _unanswered(row: VerdictRow) -> bool:
    """Return whether a further model may answer: not where views contradict each other."""
    doubted = any(why in row.verdict.reason for why in (CONTRADICTED, MOVED))
    return row.verdict.probability is None and not doubted
