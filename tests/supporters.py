"""Estimators of known quality, for comparing principals and supporters."""

from __future__ import annotations

import dataclasses

import numpy as np
import polars as pl

from graspcast import Estimates, TrainingData
from graspcast.estimates.instances import Instances
from poses import nudged, random_poses


@dataclasses.dataclass(frozen=True)
class EstimatorWorld:
    """``a`` is right half of the time and ``b`` nine times in ten; every other is pure noise."""

    n: int
    names: str
    truth: np.ndarray
    poses: dict[str, np.ndarray]
    scene: np.ndarray
    outcomes: pl.DataFrame

    @classmethod
    def make(
        cls, n: int = 240, names: str = "abc", *, scenes: int = 12, tried: str = "ab"
    ) -> EstimatorWorld:
        truth = random_poses(n)
        rng = np.random.default_rng(5)
        scene = np.arange(n) * scenes // n
        poses, rows = {}, []
        for k, name in enumerate(names):
            right = rng.random(n) < {"a": 0.5, "b": 0.9}.get(name, 0.0)
            near = nudged(truth, 10 + k, metres=0.002, radians=0.02)
            off = nudged(truth, 20 + k, metres=0.04, radians=0.4)
            noise = random_poses(n, 30 + k)
            poses[name] = np.where(right[:, None, None], near, off if name in "ab" else noise)
            if name in tried:
                error = np.linalg.norm(poses[name][:, :3, 3] - truth[:, :3, 3], axis=-1)
                rows += [
                    (
                        name,
                        "made",
                        int(scene[i]),
                        i,
                        1 + i % 2,
                        "parallel",
                        int(error[i] < 0.02),
                        0,
                    )
                    for i in range(n)
                ]
        columns = ["estimator", "dataset", "scene_id", "im_id", "obj_id", "gripper", "success"]
        outcomes = pl.DataFrame(rows, schema=[*columns, "est_id"], orient="row").with_columns(
            grasp=pl.lit("reference")
        )
        return cls(n, names, truth, poses, scene, outcomes)

    @property
    def estimates(self) -> Estimates:
        return Estimates(
            estimators=tuple(self.names),
            instances=Instances(
                dataset=np.full(self.n, "made"),
                scene_id=self.scene,
                im_id=np.arange(self.n),
                obj_id=1 + np.arange(self.n) % 2,
                est_id=np.zeros(self.n, np.int64),
            ),
            cam_T_obj=np.stack(list(self.poses.values())),
        )

    def training_data(self, principal: str) -> TrainingData:
        return TrainingData.join(
            self.estimates, self.outcomes, principal, "parallel", truth=self.truth
        )
