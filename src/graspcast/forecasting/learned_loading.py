"""Loading of estimators that are learned from, but not needed at run time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import polars as pl

from graspcast.errors import MismatchError
from graspcast.estimates.loading import Inputs
from graspcast.estimates.outcomes import checked_outcomes
from graspcast.forecasting.learned_outcomes import LearnedOutcomes, check_names
from graspcast.forecasting.outcome_joining import outcomes_of
from graspcast.forecasting.training_data import ONE_GRASP, TrainingData

__all__ = ["load_learned"]


def load_learned(
    inputs: Inputs, data: TrainingData, outcomes: pl.DataFrame | None, names: Sequence[str]
) -> TrainingData:
    """Add the outcomes of further estimators to training data.

    An instance that one of them did not find stays, without an outcome of it; what it found and the
    others did not is left out. Of several instances of an object in an image its outcomes are not
    used, since these are numbered by the principal's scores.

    Parameters
    ----------
    inputs
        All estimators' results; its notes get how many outcomes are learned from.
    data
        Instances of the estimators that are needed at run time.
    outcomes
        As :func:`graspcast.estimates.outcomes.read_outcomes` returns them.
    names
        The estimators to learn from.

    Raises
    ------
    InputError
        If the principal is among them, or none of one's grasps has a known pose error.
    UnknownNameError
        For one without estimates.
    MismatchError
        If it shares no instance with the others, or has no outcome.
    """
    check_names(names, data.principal, inputs.estimators)
    if not names:
        return data
    if outcomes is None:
        raise MismatchError(
            f"nothing can be learned from {', '.join(names)} without outcomes of their grasps",
            parameters=("learn_from", "outcomes"),
        )
    data.refuse_several(ONE_GRASP, "learn_from")
    table = checked_outcomes(outcomes)
    number = {key: i for i, key in enumerate(data.estimates.instances.to_keys())}
    wanted = tuple(sorted(set(names)))
    poses = np.full((len(wanted), len(data), 4, 4), np.nan)
    success, errors = np.full(poses.shape[:2], np.nan), poses.copy()
    silent = replace(inputs, notes=[])  # an instance that one of them lacks is not dropped
    for k, name in enumerate(wanted):
        both = silent.estimates(data.principal, only={*data.estimates.estimators, name})
        at = np.array([number.get(key, -1) for key in both.instances.to_keys()], dtype=np.int64)
        mine = at >= 0
        held, stated = outcomes_of(both, table, name, data.gripper, numbered=False)
        poses[k, at[mine]] = both.of(name)[mine]
        success[k, at[mine]] = held[mine]
        errors[k, at[mine]] = stated[mine]
    learned = LearnedOutcomes(wanted, poses, success, errors)
    learned.check(data.truth, data.gripper)
    counts = learned.counts(data.truth)
    said = ", ".join(f"{n} outcomes of {name}" for name, n in counts.items())
    inputs.notes.append(f"also learned from: {said}; the model will not need these")
    if data.learned is not None:
        learned = data.learned.joined(learned)
    return replace(data, learned=learned)
