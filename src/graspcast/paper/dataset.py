"""The published data: estimates, ground truth, outcomes and the authors' split.

The imported release (:mod:`graspcast.paper.release`) lies in ``DIR/published`` or ``DIR`` itself,
BOP dataset directories with the object models in ``DIR/bop``::

    DIR/published/lmo/{epos,gdrnpp,zebrapose}_lmo-test.csv, trials.csv, split.csv, ground_truth/
    DIR/bop/lmo/models_eval/obj_000001.ply …
    DIR/raw/<checkout of the authors' repository>, if there is one
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np
import polars as pl
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.models import Models
from graspcast.bop.results import read_results
from graspcast.errors import InputError
from graspcast.estimates.alignment import Estimates, align, concatenate
from graspcast.estimates.consistency import check_tables, describe_lengths
from graspcast.estimates.outcomes import read_all_outcomes
from graspcast.forecasting.training_data import TrainingData
from graspcast.paper.published_split import published_part, read_split

__all__ = ["DATASETS", "ESTIMATORS", "GRIPPERS", "OBJECTS", "Published"]

DATASETS = ("ycbv", "lmo")
ESTIMATORS = ("epos", "gdrnpp", "zebrapose")
GRIPPERS = ("parallel", "underactuated")
OBJECTS = {
    "ycbv-2": "Cracker box",
    "ycbv-3": "Sugar box",
    "ycbv-4": "Soup can",
    "ycbv-5": "Mustard bottle",
    "ycbv-8": "Gelatin box",
    "ycbv-9": "Potted meat can",
    "ycbv-12": "Bleach cleanser",
    "lmo-1": "Ape",
    "lmo-5": "Can",
    "lmo-6": "Cat",
    "lmo-8": "Drill",
    "lmo-9": "Duck",
    "lmo-10": "Egg carton",
    "lmo-11": "Glue",
    "lmo-12": "Hole-puncher",
}
"""The paper's names of its objects, in the order of its Table I."""


@dataclass(frozen=True)
class Published:
    """The published data in a directory, read on first use.

    Parameters
    ----------
    directory
        The directory.
    outcomes
        Outcomes of one's own (a campaign's directory, Parquet or CSV) in place of the published
        ones.

    Raises
    ------
    InputError
        If it is not a directory of the published data.
    """

    directory: Path
    own_outcomes: tuple[Path, ...] = ()

    def __init__(
        self, directory: str | PathLike[str], *, outcomes: Iterable[str | PathLike[str]] = ()
    ):
        object.__setattr__(self, "directory", Path(directory))
        object.__setattr__(self, "own_outcomes", tuple(map(Path, outcomes)))
        if not (self.files / "lmo" / "trials.csv").is_file():
            raise InputError(
                f"{directory}: no published/lmo/trials.csv here; the directory must hold the "
                "imported release (published/) and bop/",
                parameters=("data",),
            )

    @property
    def files(self) -> Path:
        """The directory of the datasets' folders."""
        inner = self.directory / "published"
        return inner if inner.is_dir() else self.directory

    def results_path(self, estimator: str, dataset: str) -> Path:
        """Return the path of the results CSV of an estimator."""
        return self.files / dataset / f"{estimator}_{dataset}-test.csv"

    @cached_property
    def bop(self) -> dict[str, BopDataset]:
        """Each dataset with its models and the published ground truth."""
        return {
            name: BopDataset(
                self.directory / "bop" / name,
                ground_truth=self.files / name / "ground_truth",
                name=name,
            )
            for name in DATASETS
        }

    @cached_property
    def models(self) -> dict[str, Models]:
        """Each dataset's object models."""
        return {name: dataset.models for name, dataset in self.bop.items()}

    @property
    def release(self) -> Path | None:
        """A checkout of the authors' repository, if ``DIR/raw`` has one."""
        found = sorted((self.directory / "raw").glob("*/Train-Grasp-Success-Prediction"))
        return found[0].parent if found else None

    @cached_property
    def outcomes(self) -> pl.DataFrame:
        """Outcomes of all trials."""
        published = [self.files / name / "trials.csv" for name in DATASETS]
        return read_all_outcomes(self.own_outcomes or published)

    @cached_property
    def estimates(self) -> Estimates:
        """The 3,152 instances of the paper's objects that all three estimators found."""
        parts = []
        for name in DATASETS:
            tables = {e: read_results(self.results_path(e, name)) for e in ESTIMATORS}
            check_tables(tables, self.bop[name].models)
            together = align(tables, dataset=name)
            parts.append(together.select(np.isin(together.objects, list(OBJECTS))))
        return concatenate(parts)

    @property
    def lengths(self) -> list[str]:
        """How large objects were read and how far away, one line for each dataset."""
        found = self.estimates
        return [
            describe_lengths(
                name,
                dataset,
                {e: found.of(e)[found.dataset == name] for e in found.estimators},
            )
            for name, dataset in self.bop.items()
        ]

    @cached_property
    def split(self) -> pl.DataFrame:
        """The authors' split of each principal and gripper."""
        return pl.concat([read_split(self.files / name / "split.csv") for name in DATASETS])

    def tried(self, principal: str, gripper: str) -> tuple[TrainingData, ndarray]:
        """Return the tried instances of a principal and gripper, and the split of each."""
        data = TrainingData.join(self.estimates, self.outcomes, principal, gripper).tried()
        return data, published_part(data.estimates, principal, gripper, self.split)
