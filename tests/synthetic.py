"""Samples whose outcomes follow from the estimators' disagreement, for tests of learning."""

from __future__ import annotations

import numpy as np

from graspcast.estimates import Estimates
from graspcast.learning.samples import Samples
from poses import nudged, random_poses


def estimates(
    n: int = 120,
    *,
    seed: int = 0,
    objects: tuple[int, ...] = (1, 2),
    scenes: int = 6,
    dataset: str = "d",
    names: tuple[str, ...] = ("a", "b", "c"),
) -> Estimates:
    """K estimators' poses; the supporters of every other instance are far off."""
    truth = random_poses(n, seed)
    far = (np.arange(n) // len(objects)) % 2 == 0
    poses = []
    for k, _ in enumerate(names):
        near = nudged(truth, seed + k, metres=0.002, radians=0.02)
        off = nudged(truth, seed + k, metres=0.04, radians=0.4)
        poses.append(np.where(far[:, None, None] & (k > 0), off, near))
    return Estimates(
        estimators=names,
        dataset=np.full(n, dataset),
        scene_id=np.arange(n) * scenes // n,
        im_id=np.arange(n),
        obj_id=np.array(objects)[np.arange(n) % len(objects)],
        inst_id=np.zeros(n, np.int64),
        cam_T_obj=np.stack(poses),
    )


def samples(n: int = 120, *, seed: int = 0, noise: float = 0.05, **options: object) -> Samples:
    """Grasps guided by the first estimator hold where the next one agrees, but for some noise."""
    given = estimates(n, seed=seed, **options)  # type: ignore[arg-type]
    apart = np.linalg.norm(given.cam_T_obj[0, :, :3, 3] - given.cam_T_obj[1, :, :3, 3], axis=-1)
    success = (apart < 0.02) ^ (np.random.default_rng(seed).random(n) < noise)
    return Samples(given, given.estimators[0], "parallel", success)
