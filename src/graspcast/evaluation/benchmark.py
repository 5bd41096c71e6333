"""The benchmark data: estimates, outcomes, ground truth, and optionally simulated trials."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.image_split import frames_of, split_of
from graspcast.estimates.instances import scene_groups
from graspcast.estimates.matching import true_poses
from graspcast.estimates.outcomes import REFERENCE_GRASP
from graspcast.evaluation.view_sets import BenchmarkViews
from graspcast.forecasting.simulated_trials import SimulatedTrials
from graspcast.forecasting.training_data import TrainingData
from graspcast.io.hashing import sha256
from graspcast.paper.dataset import Published

__all__ = ["Benchmark"]

_KEYS = ("dataset", "scene_id", "im_id", "obj_id", "est_id")


@dataclass(frozen=True, eq=False)
class Benchmark:
    """The data on which every method is trained and tested; rows are instances.

    Attributes
    ----------
    estimates
        All estimators' poses of n instances.
    truth
        Their true poses ``cam_T_obj``, metres, (n, 4, 4).
    outcomes
        Of trials, as :func:`graspcast.estimates.outcomes.read_outcomes` returns them.
    split
        As :func:`graspcast.paper.published_split.read_split` returns it.
    models
        Dataset's name to its object models.
    reported
        Which instances are of test images (:mod:`graspcast.estimates.image_split`), on which no
        reference grasp was fitted or chosen, (n,). Protocols that involve simulation test on these
        alone.
    simulated
        Outcomes of one's own campaign, if there is one.
    transferred
        Gripper's name to simulated trials of each object by errors transferred from others.
    views
        Poses of the instances fused from several views, for the protocols with views.
    """

    estimates: Estimates
    truth: Float[ndarray, "n 4 4"]
    outcomes: pl.DataFrame
    split: pl.DataFrame
    models: Mapping[str, Models]
    reported: Bool[ndarray, " n"]
    simulated: pl.DataFrame | None = None
    transferred: Mapping[str, SimulatedTrials] = field(default_factory=dict)
    views: BenchmarkViews | None = None
    _joined: dict[tuple[str, str, bool], TrainingData] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls,
        data: Published,
        simulated: pl.DataFrame | None = None,
        transferred: Mapping[str, SimulatedTrials] | None = None,
    ) -> Benchmark:
        """Build the benchmark from the published data, and optionally one's own trials.

        Of one's own trials those of reference grasps count, as the published ones are of one grasp
        of each object.
        """
        if simulated is not None and "grasp" in simulated.columns:
            simulated = simulated.filter(pl.col("grasp") == REFERENCE_GRASP)
        estimates = data.estimates
        frames = frames_of({name: dataset.ground_truth for name, dataset in data.bop.items()})
        split = split_of(estimates.dataset, estimates.scene_id, estimates.im_id, frames)
        return cls(
            estimates=estimates,
            truth=_true_poses(estimates, data.bop),
            transferred=transferred or {},
            outcomes=data.outcomes,
            split=data.split,
            models=data.models,
            reported=split == "test",
            simulated=simulated,
        )

    def __len__(self) -> int:
        return len(self.estimates)

    @cached_property
    def scenes(self) -> ndarray:
        """Scene, or block of frames, of each instance, (n,)."""
        return scene_groups(self.estimates.instances)

    @cached_property
    def _row(self) -> dict[tuple[object, ...], int]:
        return {key: row for row, key in enumerate(self.estimates.instances.to_keys())}

    def rows_of(self, estimates: Estimates) -> Int[ndarray, " m"]:
        """Find the rows of some of its instances."""
        return np.array([self._row[key] for key in estimates.instances.to_keys()], dtype=np.int64)

    def pairs(self, *, simulated: bool = False) -> list[tuple[str, str]]:
        """List the principals and grippers with outcomes, in the estimators' order."""
        table = self._table(simulated)
        found = set(table.select("estimator", "gripper").unique().rows())
        grippers = sorted({gripper for _, gripper in found})
        return [(e, g) for e in self.estimates.estimators for g in grippers if (e, g) in found]

    def tried(
        self, principal: str, gripper: str, rows: Bool[ndarray, " n"], *, simulated: bool = False
    ) -> TrainingData:
        """Select the tried instances among some rows, without their ground truth."""
        key = (principal, gripper, simulated)
        if key not in self._joined:
            table = self._table(simulated)
            self._joined[key] = TrainingData.join(self.estimates, table, principal, gripper).tried()
        whole = self._joined[key]
        return whole.select(rows[self.rows_of(whole.estimates)])

    def with_simulated_outcomes(self) -> Benchmark:
        """Replace the published outcomes by those of the campaign."""
        return replace(self, outcomes=self._table(True), _joined={})

    def digest(self, *, own_trials: bool) -> str:
        """Return the SHA-256 of all that a prediction depends on, with one's own trials or not."""
        return sha256(*self._contents(own_trials))

    def _contents(self, own_trials: bool) -> Iterator[str | ndarray]:
        for name in _KEYS:
            yield ",".join(map(str, getattr(self.estimates, name)))
        yield ",".join(self.estimates.estimators)
        yield from (self.estimates.cam_T_obj, self.truth, self.reported)
        for name, models in sorted(self.models.items()):
            for number in sorted(set(self.estimates.obj_id[self.estimates.dataset == name])):
                yield models.mesh(int(number)).vertices
        for table in (self.outcomes, self.split, self.simulated if own_trials else None):
            if table is not None:
                yield table.sort(table.columns).write_csv()
        for name, trials in sorted(self.transferred.items()) if own_trials else ():
            yield from (name, ",".join(trials.objects.tolist()))
            yield from (trials.obj_T_est, trials.success)

    def _table(self, simulated: bool) -> pl.DataFrame:
        if not simulated:
            return self.outcomes
        if self.simulated is None:
            raise InputError(
                "outcomes of your own simulated trials are needed: run a campaign, and give its "
                "directory",
                parameters=("outcomes",),
            )
        return self.simulated


def _true_poses(estimates: Estimates, datasets: Mapping[str, BopDataset]) -> ndarray:
    """Return the true pose of each instance."""
    out = true_poses(estimates, estimates.estimators[0], datasets)
    lacking = np.flatnonzero(np.isnan(out[:, 0, 0]))
    if len(lacking):
        dataset, scene, image, obj_id, _ = estimates.instances.to_keys()[lacking[0]]
        raise MismatchError(
            f"{len(lacking)} instances have no ground truth, the first object {obj_id} in image "
            f"{image} of scene {scene} of {dataset}"
        )
    return out
