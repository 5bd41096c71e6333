"""Campaign: many trials, with outcomes stored as they are computed, so that it can be resumed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing
from os import PathLike
from typing import Any

import numpy as np
import polars as pl

from graspcast._version import __version__
from graspcast.errors import CampaignStoppedError, GraspcastError
from graspcast.estimates.outcomes import (
    ERROR_COLUMNS,
    REFERENCE_GRASP,
    TRIAL_COLUMNS,
    error_numbers,
)
from graspcast.io.arguments import PATH, a, checked
from graspcast.io.hashing import canonical_json, sha256
from graspcast.io.progress import Count
from graspcast.simulation.campaign.batches import Batches
from graspcast.simulation.campaign.dataset_card import write_card
from graspcast.simulation.campaign.executors import Executor, LocalExecutor
from graspcast.simulation.campaign.jobs import Batch, TrialSetup
from graspcast.simulation.campaign.requests import SetupKey, TrialRequests
from graspcast.simulation.campaign.store import COLUMNS, Store
from graspcast.simulation.engine import mujoco
from graspcast.simulation.trial.trial import Outcome

__all__ = ["always_missed", "mostly_collided", "reason_counts", "run_campaign"]

_SETUP = ("object", "gripper", "grasp")


@checked(requests=a(TrialRequests), setups=a(Mapping), out=PATH)
def run_campaign(
    requests: TrialRequests,
    setups: Mapping[SetupKey, TrialSetup],
    out: str | PathLike[str],
    *,
    executor: Executor | None = None,
    sources: Mapping[str, str] | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> pl.DataFrame:
    """Run the trials whose outcomes are not yet in a directory, and store each outcome there.

    The outcomes do not depend on order, executor or interruptions; the same call resumes.

    Parameters
    ----------
    requests
        The trials.
    setups
        From :func:`.jobs.load_setups`.
    out
        Directory of the campaign; see :mod:`.store`.
    executor
        Where to compute; all cores of this machine if None.
    sources
        Inputs by name, with their licence, for the dataset card.
    progress
        Called with the share done and a short message.

    Returns
    -------
        All outcomes, sorted by keys; columns of :data:`.store.COLUMNS`.

    Raises
    ------
    MismatchError
        If the directory holds a campaign of another configuration.
    InputError
        If another process uses the directory, or it cannot be written.
    CampaignStoppedError
        If a worker died, or an outcome could not be stored.
    """
    store = Store(out)
    with store.lock():
        store.begin(_manifest(requests, setups, sources or {}))
        left = _rows_left(requests, store.outcomes())
        report = _Reporter(len(requests), len(requests) - len(left), progress)
        try:
            if batches := Batches(requests, left):
                with closing((executor or LocalExecutor()).run(setups, batches)) as computed:
                    for batch, outcomes in computed:
                        store.append(_table(requests, batch, outcomes, setups[batch.setup]))
                        report.add(len(outcomes))
            stored = store.finish()
        except GraspcastError as error:
            raise CampaignStoppedError(
                f"{error}. {report.done} of {len(requests)} trials are kept in {store.directory}; "
                "run the same again to resume",
                parameters=error.parameters,
            ) from error
        write_card(store.directory, stored, store.manifest)
    return stored


def reason_counts(outcomes: pl.DataFrame) -> pl.DataFrame:
    """Count the reasons of a campaign's outcomes: a row for each grasp of an object by a gripper.

    Returns
    -------
        Columns ``object``, ``gripper``, ``grasp``, ``success`` (rate), and one for each reason that
        occurs.
    """
    keys = list(_SETUP)
    counts = outcomes.pivot("reason", index=keys, values="steps", aggregate_function="len")
    rates = outcomes.group_by(keys).agg(pl.col("success").cast(pl.Float64).mean())
    reasons = pl.exclude(*keys, "success").fill_null(0)
    return rates.join(counts, on=keys).with_columns(reasons).sort(keys)


def mostly_collided(counts: pl.DataFrame) -> list[str]:
    """Return the grasps of which more than half of the trials collided, as "object by gripper".

    Parameters
    ----------
    counts
        From :func:`reason_counts`.
    """
    if "collided" not in counts.columns:
        return []
    total = pl.sum_horizontal(pl.exclude(*_SETUP, "success"))
    often = counts.filter(pl.col("collided") > total / 2)
    return [_named(key) for key in often.select(_SETUP).rows()]


def always_missed(counts: pl.DataFrame) -> list[str]:
    """Return the grasps that missed the object in every trial, as :func:`mostly_collided` does."""
    if "missed" not in counts.columns:
        return []
    total = pl.sum_horizontal(pl.exclude(*_SETUP, "success"))
    return [_named(key) for key in counts.filter(pl.col("missed") == total).select(_SETUP).rows()]


def _manifest(
    requests: TrialRequests,
    setups: Mapping[SetupKey, TrialSetup],
    sources: Mapping[str, str],
) -> dict[str, Any]:
    used = {key: setups[key] for key in sorted(requests.setups())}
    protocols = sorted({setup.settings.protocol for setup in used.values()})
    configuration = {
        "graspcast": __version__,
        "mujoco": mujoco.__version__,
        **({} if protocols == ["paper"] else {"protocol": " and ".join(protocols)}),
        **{f"estimates of {name}": digest for name, digest in sorted(requests.digests().items())},
        **{_named(key): setup.digest for key, setup in used.items()},
    }
    return {
        "format": 1,
        "hash": sha256(canonical_json(configuration)),
        "configuration": configuration,
        "trials": len(requests),
        "sources": dict(sources),
        "versions": {"numpy": np.__version__, "polars": pl.__version__},
        "setups": [_describe(setup) for setup in used.values()],
    }


def _named(key: SetupKey) -> str:
    name, gripper, grasp = key
    return f"{name} by {gripper}" + ("" if grasp == REFERENCE_GRASP else f", grasp {grasp}")


def _describe(setup: TrialSetup) -> dict[str, Any]:
    grasp_object = setup.grasp_object
    return {
        "object": grasp_object.name,
        "gripper": setup.gripper.name,
        "grasp": setup.grasp.name,
        "mass_kg": grasp_object.mass_kg,
        "friction": grasp_object.friction,
        "pieces": len(grasp_object.pieces),
        "sim_T_ref": grasp_object.sim_T_ref.tolist(),
        "obj_T_grasp": setup.grasp.obj_T_grasp.tolist(),
        "early_stop": setup.early_stop,
        "protocol": setup.settings.protocol,
        "settings": setup.settings.as_dict(),
    }


def _rows_left(requests: TrialRequests, stored: pl.DataFrame) -> np.ndarray:
    rows = requests.keys.with_row_index("row").join(stored, on=list(TRIAL_COLUMNS), how="anti")
    return np.sort(rows["row"].to_numpy()).astype(np.int64)


def _table(
    requests: TrialRequests, batch: Batch, outcomes: list[Outcome], setup: TrialSetup
) -> pl.DataFrame:
    fields = (
        *("success", "reason", "offset_m", "short_m", "force_n", "hit"),
        *("simulated_s", "computed_s", "steps"),
    )
    columns = {name: [getattr(outcome, name) for outcome in outcomes] for name in fields}
    error = error_numbers(requests.obj_T_est[batch.rows])
    return requests.keys[batch.rows].with_columns(
        **dict(zip(ERROR_COLUMNS, error.T, strict=True)),
        **{name: pl.Series(values, dtype=COLUMNS[name]) for name, values in columns.items()},
        settings=pl.lit(setup.digest[:16]),
        mujoco=pl.lit(mujoco.__version__),
    )


class _Reporter:
    """Counts the trials done, and reports the progress."""

    def __init__(
        self, total: int, stored: int, progress: Callable[[float, str], None] | None
    ) -> None:
        self.done = stored
        self._total, self._progress = total, progress
        self.add(0)

    def add(self, count: int) -> None:
        self.done += count
        if self._progress is not None:
            trials = Count(self.done, self._total, "trials")
            self._progress(trials.share, trials)
