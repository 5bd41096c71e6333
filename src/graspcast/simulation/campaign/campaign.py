"""A campaign: many trials, kept as they are computed, and gone on with after any interruption."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from os import PathLike
from typing import Any

import mujoco
import numpy as np
import polars as pl

from graspcast._version import __version__
from graspcast.errors import CampaignStoppedError, GraspcastError
from graspcast.estimates.outcomes import ERROR_COLUMNS, error_numbers
from graspcast.io.hashing import canonical_json, sha256
from graspcast.simulation.campaign.dataset_card import write_card
from graspcast.simulation.campaign.executors import Executor, LocalExecutor
from graspcast.simulation.campaign.jobs import Batch, TrialSetup
from graspcast.simulation.campaign.requests import KEY_COLUMNS, TrialRequests
from graspcast.simulation.campaign.store import COLUMNS, Store
from graspcast.simulation.trial.trial import Outcome

__all__ = ["Progress", "run_campaign"]

_CHUNK = 16


@dataclass(frozen=True)
class Progress:
    """How far a campaign is.

    Attributes
    ----------
    total
        Trials in all.
    done
        Trials of which the outcome is kept.
    found
        Those of them that were there when this run began.
    elapsed_s
        Seconds since then.
    reasons
        How often each reason came up in this run.
    """

    total: int
    done: int
    found: int
    elapsed_s: float
    reasons: Mapping[str, int]

    @property
    def rate(self) -> float:
        """Trials a second in this run; 0 before the first."""
        return (self.done - self.found) / self.elapsed_s if self.elapsed_s > 0 else 0.0

    @property
    def left_s(self) -> float:
        """Seconds left at this rate; infinite before the first outcome."""
        if self.done == self.total:
            return 0.0
        return (self.total - self.done) / self.rate if self.rate > 0 else math.inf


def run_campaign(
    requests: TrialRequests,
    pairs: Mapping[tuple[str, str], TrialSetup],
    directory: str | PathLike[str],
    *,
    executor: Executor | None = None,
    sources: Mapping[str, str] | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> pl.DataFrame:
    """Run the trials that are not yet in a directory, and keep each outcome there.

    The outcomes do not depend on the order of the trials, on the executor or on how often the
    campaign was interrupted. A process killed at any moment loses at most the trials in flight.

    Parameters
    ----------
    requests
        The trials.
    pairs
        What they are about, from :func:`~graspcast.simulation.campaign.jobs.load_setups`.
    directory
        Where the campaign is kept; see :mod:`graspcast.simulation.campaign.store`.
    executor
        Who computes; all cores of this machine if left out.
    sources
        What went in, by name, with its licence, for the card: the estimates above all.
    progress
        Called after every few trials.

    Returns
    -------
        All outcomes, sorted by keys, in the columns of
        :data:`~graspcast.simulation.campaign.store.COLUMNS`.

    Raises
    ------
    MismatchError
        If the directory holds a campaign of another configuration.
    InputError
        If another process is at work there, or it cannot be written.
    CampaignStoppedError
        If a worker died, or an outcome could not be kept; the same call goes on from there.
    """
    store = Store(directory)
    with store.lock():
        store.begin(_manifest(requests, pairs, sources or {}))
        kept = store.outcomes()
        left = _rows_left(requests, kept)
        report = _Reporter(len(requests), len(requests) - len(left), progress)
        try:
            if len(left):
                chunks = list(_batches(requests, left))
                with closing((executor or LocalExecutor()).run(pairs, chunks)) as computed:
                    for chunk, outcomes in computed:
                        store.append(_table(requests, chunk, outcomes, pairs[chunk.pair]))
                        report(outcomes)
            outcomes_table = store.finish()
        except GraspcastError as error:
            raise CampaignStoppedError(
                f"{error}. {report.done} of {len(requests)} trials are kept in {store.directory}; "
                "run the same again to go on from there"
            ) from error
        write_card(store.directory, outcomes_table, store.manifest)
    return outcomes_table


def _manifest(
    requests: TrialRequests, pairs: Mapping[tuple[str, str], TrialSetup], sources: Mapping[str, str]
) -> dict[str, Any]:
    used = {pair: pairs[pair] for pair in sorted(requests.pairs())}
    configuration = {
        "graspcast": __version__,
        "mujoco": mujoco.__version__,
        **{f"estimates of {name}": digest for name, digest in sorted(requests.digests().items())},
        **{f"{name} by {gripper}": p.digest for (name, gripper), p in used.items()},
    }
    return {
        "format": 1,
        "hash": sha256(canonical_json(configuration)),
        "configuration": configuration,
        "trials": len(requests),
        "sources": dict(sources),
        "versions": {"numpy": np.__version__, "polars": pl.__version__},
        "pairs": [_describe(pair) for pair in used.values()],
    }


def _describe(pair: TrialSetup) -> dict[str, Any]:
    grasp_object = pair.grasp_object
    return {
        "object": grasp_object.name,
        "gripper": pair.gripper.name,
        "mass_kg": grasp_object.mass_kg,
        "friction": grasp_object.friction,
        "pieces": len(grasp_object.pieces),
        "sim_T_ref": grasp_object.sim_T_ref.tolist(),
        "obj_T_grasp": pair.grasp.obj_T_grasp.tolist(),
        "early_stop": pair.early_stop,
        "settings": pair.settings.as_dict(),
    }


def _rows_left(requests: TrialRequests, kept: pl.DataFrame) -> np.ndarray:
    rows = requests.keys.with_row_index("row").join(kept, on=list(KEY_COLUMNS), how="anti")
    return np.sort(rows["row"].to_numpy()).astype(np.int64)


def _batches(requests: TrialRequests, left: np.ndarray) -> Iterator[Batch]:
    for pair in requests.pairs():
        mine = np.intersect1d(requests.rows_of(pair), left, assume_unique=True)
        for start in range(0, len(mine), _CHUNK):
            rows = mine[start : start + _CHUNK]
            yield Batch(pair, rows, requests.obj_T_est[rows])


def _table(
    requests: TrialRequests, chunk: Batch, outcomes: list[Outcome], pair: TrialSetup
) -> pl.DataFrame:
    fields = ("success", "reason", "offset_m", "simulated_s", "computed_s", "steps")
    columns = {name: [getattr(outcome, name) for outcome in outcomes] for name in fields}
    error = error_numbers(requests.obj_T_est[chunk.rows])
    return requests.keys[chunk.rows].with_columns(
        **dict(zip(ERROR_COLUMNS, error.T, strict=True)),
        **{name: pl.Series(values, dtype=COLUMNS[name]) for name, values in columns.items()},
        settings=pl.lit(pair.digest[:16]),
        mujoco=pl.lit(mujoco.__version__),
    )


class _Reporter:
    """Counts, and tells whoever wants to know."""

    def __init__(self, total: int, found: int, progress: Callable[[Progress], None] | None):
        self.total, self.found, self.done = total, found, found
        self._progress, self._reasons = progress, dict[str, int]()
        self._started = time.perf_counter()
        self([])

    def __call__(self, outcomes: list[Outcome]) -> None:
        self.done += len(outcomes)
        for outcome in outcomes:
            self._reasons[outcome.reason] = self._reasons.get(outcome.reason, 0) + 1
        if self._progress is not None:
            elapsed = time.perf_counter() - self._started
            self._progress(
                Progress(self.total, self.done, self.found, elapsed, dict(self._reasons))
            )
