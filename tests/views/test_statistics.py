"""Statistics of a fusion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from graspcast.pose.metrics import translation_error
from graspcast.pose.ray_frame import compressed, relative
from graspcast.views.statistics import RESIDUALS, STATISTICS, fusion_statistics
from looked_at import Training, fused, training


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Training:
    return training(tmp_path_factory.mktemp("given"))


def column(values: np.ndarray, name: str) -> np.ndarray:
    return np.asarray(values[:, list(STATISTICS).index(name)])


def test_they_are_what_they_are_called(given: Training) -> None:
    some = fused(given.results, given.models, given.motion)
    values = fusion_statistics(some)
    assert values.shape == (len(some), len(STATISTICS)) and np.isfinite(values).all()
    assert_allclose(column(values, "views"), some.views)
    assert_allclose(column(values, "estimates"), some.poses.used.sum(axis=(1, 2)))
    assert_allclose(column(values, "parallax"), some.poses.parallax_rad)
    distance = np.linalg.norm(some.poses.cam_T_obj[:, :3, 3], axis=1)
    assert_allclose(np.exp(column(values, "sd_along")) * distance, some.poses.along_m)
    variance = np.linalg.eigvalsh(some.poses.covariance[:, :3, :3])
    assert_allclose(np.exp(column(values, "sd_largest")), np.sqrt(variance[:, 2]))
    i = 3
    used = some.poses.used[i]
    away = some.poses.cam_T_est[i][used][:, :3, 3] - some.poses.cam_T_obj[i, :3, 3]
    farthest = np.linalg.norm(away, axis=1).max() / 0.5  # no camera is nearer than 0.5 m
    assert np.exp(column(values, "along_maximum")[i]) < farthest


def test_residuals_grow_when_estimates_scatter_more(given: Training) -> None:
    some = fused(given.results, given.models, given.motion)
    rng = np.random.default_rng(0)
    worse = {}
    for name, table in given.results.items():
        columns = dict(vars(table))
        columns["cam_T_obj"] = table.cam_T_obj.copy()
        columns["cam_T_obj"][:, :3, 3] += rng.normal(scale=0.01, size=(len(table), 3))
        worse[name] = type(table)(**columns)
    more = fused(worse, given.models, given.motion)
    one, other = (fusion_statistics(each)[:, RESIDUALS].mean(axis=0) for each in (some, more))
    assert (other[:6] > one[:6]).all()  # along and across


def test_they_do_not_depend_on_the_order_of_estimators(given: Training) -> None:
    turned = dict(reversed(given.results.items()))
    some = fused(given.results, given.models, given.motion)
    from graspcast.views.fused_estimates import fuse_estimates

    other = fuse_estimates(
        turned, given.motion, dataset="d", principal="a", models=given.models, views_from="all"
    )
    error = translation_error(some.poses.cam_T_obj, other.poses.cam_T_obj)
    assert np.max(error) < 1e-6
    assert_allclose(fusion_statistics(some), fusion_statistics(other), atol=1e-3)


def test_no_instance_has_no_statistics(given: Training, tmp_path: Path) -> None:
    assert len(RESIDUALS) == 9 and len(set(STATISTICS.values())) >= len(STATISTICS) - 6


def log_residual(value: float) -> float:
    return float(np.log(1e-4 + value))


def test_every_statistic_is_its_definition(given: Training) -> None:
    """Estimate by estimate, also where only some of them saw the object."""
    rng = np.random.default_rng(5)
    some_results = {
        name: table.select(np.flatnonzero(rng.random(len(table)) < 0.7)) if name != "a" else table
        for name, table in given.results.items()
    }
    some = fused(some_results, given.models, given.motion)
    values = fusion_statistics(some)
    poses, gathered = some.poses, some.gathered
    counts = set()
    for i in range(0, len(some), 3):
        pose, used = poses.cam_T_obj[i], poses.used[i]
        distance = np.linalg.norm(pose[:3, 3])
        along, across, angle = [], [], []
        for v, k in np.argwhere(used).tolist():
            away = poses.cam_T_est[i, v, k, :3, 3] - pose[:3, 3]
            seen_from = gathered.view_T_obj[i, v, k, :3, 3]
            far = np.linalg.norm(seen_from)
            ray = gathered.cam_T_view[i, v, :3, :3] @ seen_from / far
            along.append(abs(away @ ray) / far)
            across.append(np.linalg.norm(away - (away @ ray) * ray) / far)
            turn = poses.cam_T_est[i, v, k, :3, :3] @ pose[:3, :3].T
            angle.append(Rotation.from_matrix(turn).magnitude())
        mine = [
            compressed(relative(pose, poses.cam_T_est[i, 0, k]))
            for k in np.flatnonzero(gathered.present[i, 0])
        ]
        raw = [
            relative(pose, poses.cam_T_est[i, 0, k]) for k in np.flatnonzero(gathered.present[i, 0])
        ]
        assert len(mine) == len(raw)
        axes = np.sqrt(np.linalg.eigvalsh(poses.covariance[i, :3, :3]))
        wanted = {
            "sd_along": np.log(poses.along_m[i] / distance),
            "sd_across": np.log(poses.across_m[i] / distance),
            "sd_rotation": np.log(poses.rotation_rad[i]),
            "parallax": poses.parallax_rad[i],
            "views": some.views[i],
            "estimates": len(along),
            "dropped": poses.dropped[i].sum(),
            "distance": distance,
            "sd_smallest": np.log(axes[0]),
            "sd_largest": np.log(axes[2]),
        }
        for name, sizes in (("along", along), ("across", across), ("angle", angle)):
            wanted[f"{name}_median"] = log_residual(float(np.median(sizes)))
            wanted[f"{name}_maximum"] = log_residual(max(sizes))
            wanted[f"{name}_mean"] = log_residual(float(np.mean(sizes)))
        own = compressed(np.median(raw, axis=0))
        wanted |= dict(zip(list(STATISTICS)[-6:], own.tolist(), strict=True))
        assert_allclose(values[i], [wanted[name] for name in STATISTICS], rtol=1e-5, atol=1e-7)
        counts.add((len(along), len(raw)))
    assert len({a for a, _ in counts}) > 3 and {b for _, b in counts} >= {1, 2, 3}
