"""Fused poses of the benchmark's instances, by which views serve and how well motion is known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Int
from numpy import ndarray

from graspcast.estimates.alignment import Estimates
from graspcast.forecasting.view_data import ViewData
from graspcast.views.choice import MIN_PARALLAX_RAD
from graspcast.views.fused_estimates import FusedEstimates
from graspcast.views.statistics import fusion_statistics

__all__ = ["BenchmarkViews", "ViewModelRule", "ViewRow", "ViewSet", "view_rows"]


@dataclass(frozen=True)
class ViewModelRule:
    """What a view model is trained on; rows of the same rule share it.

    Attributes
    ----------
    alone
        The only estimator, or an empty string for all.
    noise_mm
        Of the camera motion, per axis, with 0.1 degrees for each millimetre.
    estimated
        Whether the motion is estimated from other objects' estimates.
    pooled
        Whether success given error is also learned from the outcomes of grasps that the other
        estimators guided, though only one is fused.
    """

    alone: str = ""
    noise_mm: float = 0.0
    estimated: bool = False
    pooled: bool = False


@dataclass(frozen=True)
class ViewRow:
    """One row of the tables with several views: which views serve, and what forecasts them.

    Attributes
    ----------
    name
        In tables. Rows of the same name with different estimators alone are averaged.
    views
        At most so many.
    rule
        Of the model.
    earlier
        Whether earlier images alone serve.
    other_images
        Whether the motion is that of other images: a sanity check.
    parallax_deg
        The range of the views' parallax to the judged one.
    averaged
        Whether the forecast is averaged with that from one view.
    """

    name: str
    views: int
    rule: ViewModelRule = field(default_factory=ViewModelRule)
    earlier: bool = False
    other_images: bool = False
    parallax_deg: tuple[float, float] | None = None
    averaged: bool = False

    @property
    def fusion(self) -> ViewRow:
        """The row as far as fused poses depend on it."""
        rule = replace(self.rule, pooled=False)
        return ViewRow("", self.views, rule, self.earlier, self.other_images, self.parallax_deg)

    @property
    def key(self) -> str:
        """A name of its own, for files: that of the row and of the estimator alone."""
        return " ".join(filter(None, [self.name, self.rule.alone]))

    @property
    def min_parallax_rad(self) -> float:
        """Least angle between two views."""
        if self.parallax_deg is None:
            return MIN_PARALLAX_RAD
        return float(np.deg2rad(self.parallax_deg[0]))


def view_rows(estimators: Sequence[str]) -> list[ViewRow]:
    """Return the rows of the table with several views."""
    out = [ViewRow(f"{v} views", v) for v in (2, 3, 5)]
    out.append(ViewRow("3 views, earlier images", 3, earlier=True))
    for v in (2, 3):
        each = [ViewModelRule(alone=name) for name in estimators]
        out += [ViewRow(f"one estimator alone, {v} views", v, rule) for rule in each]
    pooled = [ViewModelRule(alone=name, pooled=True) for name in estimators]
    name = "one estimator alone, 3 views, outcomes of all in training"
    out += [ViewRow(name, 3, rule) for rule in pooled]
    for low, high in ((2.0, 6.0), (6.0, 12.0), (12.0, 20.0), (20.0, 30.0), (30.0, 60.0)):
        out.append(ViewRow(f"3 views, parallax {low:g}-{high:g}°", 3, parallax_deg=(low, high)))
    for mm in (1.0, 3.0, 5.0):
        name = f"3 views, motion to {mm:g} mm, {mm / 10:g}°"
        out.append(ViewRow(name, 3, ViewModelRule(noise_mm=mm)))
    estimated = ViewModelRule(estimated=True)
    out.append(ViewRow("3 views, motion from estimates", 3, estimated))
    out.append(ViewRow("the same, averaged with one view", 3, estimated, averaged=True))
    out.append(ViewRow("3 views, motion of other images", 3, other_images=True))
    return out


@dataclass(frozen=True, eq=False)
class ViewSet:
    """Fused poses of those instances that have several views, as one row of the table has them.

    Attributes
    ----------
    data
        Rows into some instances, fused poses and statistics. Also where the views contradict each
        other so that one is left.
    fused
        What they were taken from.
    part, number
        Which of these each is of, and its number there, (m,).
    """

    data: ViewData
    fused: tuple[FusedEstimates, ...]
    part: Int[ndarray, " m"]
    number: Int[ndarray, " m"]

    @classmethod
    def of(cls, estimates: Estimates, fused: Iterable[FusedEstimates]) -> ViewSet:
        """Join fused poses with instances by key, those with several views gathered."""
        number = {key: i for i, key in enumerate(estimates.instances.to_keys())}
        fused = tuple(fused)
        columns: list[list[ndarray]] = [[], [], [], [], [], []]
        for p, each in enumerate(fused):
            row = np.array([number.get(k, -1) for k in each.instances.to_keys()], dtype=np.int64)
            several = each.gathered.present.any(axis=2).sum(axis=1) > 1
            single = each.gathered.present.shape[1] == 1
            kept = np.flatnonzero((row >= 0) & (several | single))
            found = (
                row[kept],
                each.poses.cam_T_obj[kept],
                fusion_statistics(each)[kept],
                each.views[kept],
                np.full(len(kept), p),
                kept,
            )
            for column, values in zip(columns, found, strict=True):
                column.append(values)
        row, poses, statistics, views, part, at = (np.concatenate(c) for c in columns)
        data = ViewData(row, poses, statistics, views, fused[0].estimators, {})
        return cls(data, fused, part, at)

    def __len__(self) -> int:
        return len(self.data)

    @property
    def gathered(self) -> Int[ndarray, " m"]:
        """How many views of each instance there were, whether they entered or not, (m,)."""
        out = np.zeros(len(self), dtype=np.int64)
        for part, fused in enumerate(self.fused):
            mine = self.part == part
            out[mine] = fused.gathered.present[self.number[mine]].any(axis=2).sum(axis=1)
        return out

    def select(self, which: Bool[ndarray, " n"] | Int[ndarray, " k"], count: int) -> ViewSet:
        """Keep the fused poses of selected instances, of ``count`` in all."""
        chosen = np.flatnonzero(which) if which.dtype == bool else which
        kept = np.isin(self.data.row, chosen)
        data = self.data.select(which, count)
        return ViewSet(data, self.fused, self.part[kept], self.number[kept])


@dataclass(frozen=True, eq=False)
class BenchmarkViews:
    """Fused poses of instances: for training by rule, to forecast by row.

    Attributes
    ----------
    train
        From 1, 2, 3 and 5 views.
    test
        By :attr:`ViewRow.fusion`; also one with a single view, without which there is no belief
        about what a second one would show.
    """

    train: Mapping[ViewModelRule, ViewData]
    test: Mapping[ViewRow, ViewSet]

    def select(
        self, train: Bool[ndarray, " n"], test: Int[ndarray, " m"], count: int
    ) -> BenchmarkViews:
        """Keep training instances and test instances, of ``count`` in all."""
        return BenchmarkViews(
            {rule: data.select(train, count) for rule, data in self.train.items()},
            {row: found.select(test, count) for row, found in self.test.items()},
        )
