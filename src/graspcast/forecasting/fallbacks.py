"""Several forecasters of one principal: where a supporter is missing, one trained without it.

Each was trained for its own set of supporters, so a missing estimate is never guessed: an instance
is forecast by the model with the most supporters, all of which have an estimate of it, and the
verdict says which model that was.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import InstanceKey
from graspcast.estimates.loading import Inputs
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.grasp_ranking import Reachable, refuse_mask
from graspcast.forecasting.model_card import ModelCard
from graspcast.forecasting.novelty import OOD_ALPHA
from graspcast.forecasting.verdict import Verdict, VerdictRow, verdict_rows
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.look_policy import LookPolicy
from graspcast.io.arguments import NAMED, a, refuse_unless, sequence

__all__ = ["Fallbacks", "certificate_made_for", "certificate_of"]


class Fallbacks:
    """Forecasters of one principal and gripper, the one with the most supporters first.

    Raises
    ------
    InputError
        If there is none, or two are for the same supporters.
    MismatchError
        If they differ in principal or gripper.
    """

    def __init__(self, forecasters: Iterable[Forecaster]):
        given = list(forecasters) if isinstance(forecasters, Iterable) else forecasters
        refuse_unless(sequence(a(Forecaster)), given, "Fallbacks", "forecasters")
        self.forecasters = sorted(given, key=lambda f: -len(f.card.supporters))
        if not self.forecasters:
            raise InputError("at least one model is needed")
        first = self.forecasters[0].card
        sets = set()
        for forecaster in self.forecasters:
            card = forecaster.card
            if (card.principal, card.gripper) != (first.principal, first.gripper):
                raise MismatchError(
                    f"a model for {card.principal} and the {card.gripper} gripper cannot stand in "
                    f"for one of {first.principal} and the {first.gripper} gripper"
                )
            if (supporters := frozenset(card.supporters)) in sets:
                raise InputError(f"two models are for {card.principal} with {_named(card)}")
            sets.add(supporters)

    def __iter__(self) -> Iterator[Forecaster]:
        return iter(self.forecasters)

    def usable(self, estimators: Collection[str]) -> list[Forecaster]:
        """Return the forecasters that need no other estimators than these, in order.

        Raises
        ------
        MismatchError
            Naming what each lacks, if there is none.
        """
        out, lacks = [], []
        for forecaster in self.forecasters:
            card = forecaster.card
            if lacking := card.lacking(estimators):
                lacks.append(f"{', '.join(lacking)} for the model with {len(card.supporters)}")
            else:
                out.append(forecaster)
        if not out:
            raise MismatchError(
                f"there are no estimates by {'; nor by '.join(lacks)} supporters; given: "
                f"{', '.join(estimators) or 'none'}. Train a model without what is missing, and "
                "give it as a further model",
                parameters=("model",),
            )
        return out

    def verdict_rows(
        self,
        inputs: Inputs,
        *,
        threshold: float = 0.5,
        certificates: Sequence[Certificate] = (),
        ood_alpha: float = OOD_ALPHA,
        explain: bool = False,
        reachable: Reachable | None = None,
    ) -> list[VerdictRow]:
        """Return a verdict on every instance of the principal's, ordered by key.

        Parameters
        ----------
        inputs
            Estimates of any datasets; its notes get what is left out.
        threshold
            Attempt at this probability or above it.
        certificates
            Certified thresholds instead, one for each model.
        ood_alpha
            Abstain where the p-value of a disagreement is this or less.
        explain
            Whether each reason says which features moved the probability most.
        reachable
            As for :meth:`Forecaster.rank`.

        Raises
        ------
        MismatchError
            If no model can be used, no instance has a pose by all estimators of one, or a
            certificate is missing or belongs to another model.
        """
        usable = self.usable(inputs.estimators)
        rows: dict[InstanceKey, VerdictRow] = {}
        for forecaster in usable:
            card = forecaster.card
            try:
                estimates = inputs.estimates(card.principal, only=card.estimators)
            except MismatchError as error:  # no instance has all of these
                if forecaster is usable[-1] and not rows:
                    raise
                inputs.notes.append(str(error))
                continue
            least: float | None = threshold
            guarantee = None
            if certificates:
                refuse_mask(reachable)
                overall = certificate_of(forecaster, certificates, ood_alpha).overall
                least, guarantee = overall.threshold, str(overall)
            verdicts = forecaster.verdicts(
                estimates,
                inputs.models,
                threshold=least,
                guarantee=guarantee,
                ood_alpha=ood_alpha,
                explain=explain,
                reachable=reachable,
            )
            if len(usable) > 1:
                verdicts = [_with_names(given, forecaster) for given in verdicts]
            who = {"principal": card.principal, "gripper": card.gripper}
            for row in verdict_rows(estimates, verdicts, **who):
                if row.key not in rows or rows[row.key].verdict.probability is None:
                    rows[row.key] = row
        return [rows[key] for key in sorted(rows)]

    def predict(
        self,
        poses: Mapping[str, Float[ndarray, "4 4"] | None],
        object_name: str,
        *,
        models: Mapping[str, Models] | None = None,
        **options: Any,
    ) -> Verdict:
        """Return the verdict on one instance by the first model that has all its poses.

        As :meth:`graspcast.Forecaster.predict`: a pose that is None or not sane is none. If every
        model lacks one, the verdict is to abstain.

        Raises
        ------
        MismatchError
            If every model needs an estimator that is not named, or knows other objects.
        """
        refuse_unless(NAMED, poses, "Fallbacks.predict", "poses")
        usable = self.usable(poses)
        knowing = [f for f in usable if object_name in f.card.objects] or usable[:1]
        for forecaster in knowing:
            verdict = forecaster.predict(poses, object_name, models=models, **options)
            if len(usable) > 1:
                verdict = _with_names(verdict, forecaster)
            if verdict.probability is not None:
                break
        return verdict


def _with_names(verdict: Verdict, forecaster: Forecaster) -> Verdict:
    """Say which supporters a verdict uses."""
    return replace(verdict, reason=f"{verdict.reason}; with {_named(forecaster.card)}")


def _named(card: ModelCard) -> str:
    return ", ".join(card.supporters) or "no supporter"


def certificate_of(
    forecaster: Forecaster,
    certificates: Sequence[Certificate],
    ood_alpha: float,
    policy: LookPolicy | None = None,
) -> Certificate:
    """Return the certificate that was made for a forecaster.

    Parameters
    ----------
    forecaster
        Whose verdicts are meant.
    certificates
        Of one or more forecasters.
    ood_alpha, policy
        As for :meth:`Certificate.check_belongs_to`.

    Raises
    ------
    MismatchError
        If there is none, or it was made with another ``ood_alpha`` or of another policy: what is
        attempted would not be what was certified.
    """
    certificate = certificate_made_for(forecaster, certificates)
    certificate.check_belongs_to(forecaster.card.digest, ood_alpha, policy)
    return certificate


def certificate_made_for(
    forecaster: Forecaster, certificates: Sequence[Certificate]
) -> Certificate:
    """Return the certificate of a forecaster's model; whether its policy is theirs is not checked.

    Raises
    ------
    MismatchError
        If there is none.
    """
    card = forecaster.card
    for certificate in certificates:
        if certificate.provenance.get("model") == card.digest:
            return certificate
    raise MismatchError(
        f"no certificate was made for the model with {_named(card)}: certify it, and "
        "give its certificate too",
        parameters=("certificate",),
    )
