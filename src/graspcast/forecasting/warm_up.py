"""Everything that a first verdict would wait for, done beforehand.

The first verdicts load compiled code (on a machine's first run they compile it, for some seconds),
import modules, and read the objects' meshes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import MismatchError
from graspcast.estimates.alignment import assign
from graspcast.estimates.instances import split_object_name
from graspcast.pose.transforms import transform

if TYPE_CHECKING:
    from graspcast.forecasting.forecaster import Forecaster

__all__ = ["warm_up"]


def warm_up(forecaster: Forecaster, models: Mapping[str, Models] | None = None) -> None:
    """Prepare, so that the first verdict is as fast as later ones.

    Call it once, before verdicts are due, and before threads are started or the process forks: it
    compiles or loads the code, makes late imports, reads the meshes, and makes a verdict on each
    object, of poses without meaning. No result depends on it.

    Parameters
    ----------
    forecaster
        The one that will be asked.
    models
        Dataset's name to its object models, the same that verdicts will be asked with. Objects
        that they lack are left out.

    Raises
    ------
    MismatchError
        If no object can be forecast: models are needed, and there are none.
    """
    objects = forecaster.card.objects
    known = [name for name in objects if _known(name, models)] or objects[:1]
    refusals = [_refusal(forecaster, name, models) for name in known]
    if all(refusals):
        raise next(error for error in refusals if error)
    # Where an image shows several instances of an object; the import is late.
    assign(np.zeros((2, 3)), np.zeros((2, 3)))


def _known(name: str, models: Mapping[str, Models] | None) -> bool:
    dataset, obj_id = split_object_name(name)
    return models is None or (dataset in models and obj_id in models[dataset].info)


def _refusal(
    forecaster: Forecaster, name: str, models: Mapping[str, Models] | None
) -> MismatchError | None:
    """Make a verdict, and return why the method cannot, if so."""
    dataset, obj_id = split_object_name(name)
    diameter = models[dataset][obj_id].diameter_m if models and dataset in models else 0.1
    poses: dict[str, ndarray | None] = {
        estimator: transform(np.eye(3), np.array([0.0, 0.01 * diameter * i, 10 * diameter]))
        for i, estimator in enumerate(forecaster.card.estimators)
    }
    try:
        forecaster.predict(poses, name, models=models, explain=True)
    except MismatchError as error:
        return error
    return None
