"""Trial requests of a campaign: estimates of instances, each with a gripper and a grasp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.estimates.outcomes import REFERENCE_GRASP, TRIAL_COLUMNS, TRIAL_SCHEMA
from graspcast.io.hashing import sha256

__all__ = ["SetupKey", "TrialRequests"]

SetupKey = tuple[str, str, str]
"""Names of object, gripper and grasp: what the trials of one setup have in common."""

_RIGID_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class TrialRequests:
    """Trials to run, one per row.

    Attributes
    ----------
    keys
        The columns of :data:`~graspcast.estimates.outcomes.TRIAL_COLUMNS` (``grasp`` may be left
        out: the reference grasp), and ``object``, the object's name in the catalogue; where
        that column is not given it is ``dataset-obj_id``. No row may be there twice.
    obj_T_est
        The estimates seen from the true objects, ``inv(cam_T_gt) @ cam_T_est``, metres, (n, 4, 4).

    Raises
    ------
    InputError
        If a column is missing, a value is null, two rows have the same keys, or a pose is not a
        finite rigid transform; the message names the first such row.
    """

    keys: pl.DataFrame
    obj_T_est: Float[ndarray, "n 4 4"]

    def __post_init__(self) -> None:
        if "grasp" not in self.keys.columns:
            with_grasp = self.keys.with_columns(grasp=pl.lit(REFERENCE_GRASP))
            object.__setattr__(self, "keys", with_grasp)
        missing = [name for name in TRIAL_COLUMNS if name not in self.keys.columns]
        if missing:
            raise InputError(f"the trials lack the column {missing[0]!r}; needed: {_names()}")
        keys = self.keys
        if "object" not in keys.columns:
            keys = keys.with_columns(object=pl.format("{}-{}", "dataset", "obj_id"))
        try:
            keys = keys.select(
                *(pl.col(name).cast(kind) for name, kind in TRIAL_SCHEMA.items()),
                pl.col("object").cast(pl.String),
            )
        except pl.exceptions.PolarsError as error:
            raise InputError(f"the trials' keys have the wrong type: {error}") from error
        poses = np.array(self.obj_T_est, dtype=np.float64)
        if poses.shape != (len(keys), 4, 4):
            raise InputError(f"{len(keys)} trials need poses (n, 4, 4), not {poses.shape}")
        object.__setattr__(self, "keys", keys)
        object.__setattr__(self, "obj_T_est", poses)
        self._check()

    def _check(self) -> None:
        nulls = self.keys.select(pl.any_horizontal(pl.all().is_null())).to_series()
        if nulls.any():
            raise InputError(f"a trial has no value in some column: {self.describe(nulls)}")
        repeated = self.keys.select(list(TRIAL_COLUMNS)).is_duplicated()
        if repeated.any():
            raise InputError(f"two trials have the same keys: {self.describe(repeated)}")
        poses = self.obj_T_est
        finite = np.isfinite(poses).all(axis=(1, 2))
        if not finite.all():
            raise InputError(
                f"{(~finite).sum()} estimates are not finite numbers, the first is that of "
                f"{self.describe(~finite)}; leave out what an estimator did not find"
            )
        R = poses[:, :3, :3]
        orthogonal = np.isclose(R @ np.swapaxes(R, 1, 2), np.eye(3), atol=_RIGID_TOLERANCE)
        rigid = orthogonal.all(axis=(1, 2)) & (np.linalg.det(R) > 0)
        rigid &= (poses[:, 3] == [0, 0, 0, 1]).all(axis=1)
        if not rigid.all():
            raise InputError(
                f"{(~rigid).sum()} estimates are not rigid transforms, the first is that of "
                f"{self.describe(~rigid)}"
            )

    def __len__(self) -> int:
        return len(self.keys)

    def describe(self, rows: ndarray | pl.Series) -> str:
        """Return the keys of the first row of a mask, for a message."""
        row = self.keys.row(int(np.argmax(np.asarray(rows))), named=True)
        return ", ".join(f"{name} {row[name]}" for name in TRIAL_COLUMNS)

    def select(self, rows: Int[ndarray, " m"]) -> TrialRequests:
        """Return the trials with the given row numbers."""
        return TrialRequests(self.keys[rows], self.obj_T_est[rows])

    def setups(self) -> list[SetupKey]:
        """Return the objects, grippers and grasps that occur together, in order of appearance."""
        columns = self.keys.select("object", "gripper", "grasp")
        return list(columns.unique(maintain_order=True).iter_rows())

    def rows_of(self, object_name: str, gripper: str, grasp: str) -> Int[ndarray, " m"]:
        """Return the row numbers of an object, a gripper and a grasp."""
        mine = (
            (pl.col("object") == object_name)
            & (pl.col("gripper") == gripper)
            & (pl.col("grasp") == grasp)
        )
        return self.keys.select(mine.arg_true()).to_series().to_numpy().astype(np.int64)

    def digests(self) -> dict[str, str]:
        """Return the SHA-256 of keys and poses, as hex, for each estimator on each dataset."""
        order = self.keys.with_row_index("row").sort(list(TRIAL_COLUMNS))
        out = {}
        for group, rows in order.group_by("estimator", "dataset", maintain_order=True):
            index = rows["row"].to_numpy()
            poses = np.asarray(self.obj_T_est[index], dtype="<f8")
            out["{} on {}".format(*group)] = sha256(rows.drop("row").write_csv(), poses)
        return out


def _names() -> str:
    return ", ".join(TRIAL_COLUMNS)
