"""Models that stand in for one another where a supporter is missing at run time.

Each was trained for its own set of supporters, so a missing one is never guessed: the instance goes
to the model with the most supporters of which none is missing, and the verdict says which.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.verdict import Verdict

__all__ = ["Fallbacks"]


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
        self.forecasters = sorted(forecasters, key=lambda f: -len(f.card.supporters))
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
                raise InputError(f"two models are for the supporters {', '.join(card.supporters)}")
            sets.add(supporters)

    def __iter__(self) -> Iterator[Forecaster]:
        return iter(self.forecasters)

    def usable(self, estimators: Collection[str]) -> list[Forecaster]:
        """Those that need no other estimators than these, in order.

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
                "give it as a further --model"
            )
        return out

    def predict(
        self,
        poses: Mapping[str, Float[ndarray, "4 4"]],
        object_name: str,
        *,
        models: Mapping[str, Models] | None = None,
        **options: Any,
    ) -> Verdict:
        """As :meth:`graspcast.Forecaster.predict`, by the first model that lacks no pose.

        A pose that is not finite counts as missing.

        Raises
        ------
        MismatchError
            If every model lacks one.
        """
        found = {name: pose for name, pose in poses.items() if np.isfinite(pose).all()}
        forecaster = self.usable(found)[0]
        return forecaster.predict(found, object_name, models=models, **options)
