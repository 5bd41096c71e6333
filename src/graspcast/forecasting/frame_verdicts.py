"""Verdicts on all that the estimators found in an image, or in several."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.estimates.alignment import align
from graspcast.forecasting.grasp_ranking import Reachable
from graspcast.forecasting.novelty import OOD_ALPHA
from graspcast.forecasting.verdict import Verdict, VerdictRow, check_threshold, verdict_rows

if TYPE_CHECKING:
    from graspcast.forecasting.forecaster import Forecaster

__all__ = ["predict_frame"]


def predict_frame(
    forecaster: Forecaster,
    results: Mapping[str, Results],
    dataset: str,
    *,
    threshold: float = 0.5,
    models: Mapping[str, Models] | None = None,
    ood_alpha: float = OOD_ALPHA,
    explain: bool = False,
    reachable: Reachable | None = None,
) -> list[VerdictRow]:
    """Decide on every instance that the principal found in an image, or in several.

    Parameters
    ----------
    results
        Estimator's name to all that it found, of any objects
        (:meth:`graspcast.bop.results.Results.from_frame` makes it from arrays).
    dataset
        The dataset's name, as in training.
    threshold, models, ood_alpha, explain
        As for :meth:`predict`.
    reachable
        As for :meth:`rank`.

    Returns
    -------
        One row for each sane estimate of the principal's, ordered by instance. Where a
        supporter found nothing, or its pose is not sane, the verdict is to abstain.

    Raises
    ------
    MismatchError
        For other estimators or objects than it was trained for.
    InputError
        For a threshold outside [0, 1].
    """
    check_threshold(threshold)
    forecaster.card.check_estimators(results)
    card = forecaster.card
    mine = {name: results[name] for name in card.estimators}
    who = {"dataset": dataset, "anchor": card.principal}
    estimates = align(mine, **who, required=False, models=models)
    verdicts: list[Verdict] = []
    if len(estimates):
        verdicts = forecaster.verdicts(
            estimates,
            models,
            threshold=threshold,
            ood_alpha=ood_alpha,
            explain=explain,
            reachable=reachable,
        )
    return verdict_rows(estimates, verdicts, principal=card.principal, gripper=card.gripper)
