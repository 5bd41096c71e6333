"""The motion that objects in two images state together."""

from __future__ import annotations

import numpy as np
import pytest
from numpy import ndarray

from graspcast.pose.transforms import (
    compose,
    invert,
    rotation_from_vector,
    rotation_vector,
    transform,
)
from graspcast.views.object_consensus import (
    ObjectPoses,
    agreement,
    fit_motion,
    medoid,
    statements,
)
from static_scenes import objects, orbit, seen

ALONE = np.eye(4)[None]
CAMERAS = orbit(5, degrees=20)
TRUE = np.asarray(compose(invert(CAMERAS[:1]), CAMERAS[1:]))
HALF_TURN = np.stack([np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])])
SIZES = (0.005, 0.02)


def tables(poses: ndarray) -> tuple[ObjectPoses, ObjectPoses]:
    shape = poses.shape[:2]
    every = ObjectPoses(
        poses,
        np.ones(shape, bool),
        np.tile(SIZES[0] ** 2 * np.eye(3), (*shape, 1, 1)),
        np.full(shape, SIZES[1] ** 2),
    )
    return every.at(0), every.at(np.arange(1, len(poses)))


def scattered(poses: ndarray, seed: int) -> ndarray:
    rng = np.random.default_rng(seed)
    shape = (*poses.shape[:-2], 3)
    out = poses.copy()
    out[..., :3, 3] += rng.normal(0, SIZES[0], shape)
    turn = rotation_from_vector(rng.normal(0, SIZES[1], shape))
    out[..., :3, :3] = turn @ out[..., :3, :3]
    return out


def test_every_symmetry_is_a_statement_and_the_right_one_is_found() -> None:
    poses = seen(CAMERAS, objects(3))
    poses[2, 0] = poses[2, 0] @ HALF_TURN[1]
    cam, views = tables(poses)
    symmetries = [HALF_TURN, ALONE, ALONE]
    stated = statements(cam, views, list(enumerate(symmetries)))
    assert stated.owner.tolist() == [0, 0, 1, 2]
    at = views.cam_T_obj[..., :3, 3].mean(axis=1)
    best, count = medoid(stated, stated.present, at, (0.01, 0.05))
    rows = np.arange(4)
    np.testing.assert_allclose(stated.cam_T_view[rows, best], TRUE, atol=1e-9)
    assert (count[rows, best] == 3).all()
    found, _, distance = fit_motion(TRUE, cam, views, np.ones((4, 3), bool), symmetries)
    np.testing.assert_allclose(found, TRUE, atol=1e-9)
    assert distance.max() < 1e-9


def test_an_object_that_moved_is_found() -> None:
    poses = seen(CAMERAS, objects(4))
    poses[1:, 3, :3, 3] += [0.2, 0.0, 0.0]
    cam, views = tables(scattered(poses, 1))
    start = statements(cam, views, [(0, ALONE)]).cam_T_view[:, 0]
    found, _, distance = fit_motion(start, cam, views, np.ones((4, 4), bool), [ALONE] * 4)
    assert (distance[:, 3] > 100).all() and (distance[:, :3] < 30).all()
    assert np.linalg.norm((found - TRUE)[:, :3, 3], axis=-1).max() < 0.04
    alike, turned = agreement(
        statements(cam, views, [(0, ALONE)]), cam.cam_T_obj[3], views.cam_T_obj[:, 3], ALONE
    )
    assert alike.min() > 0.1 and turned.max() < 0.2


def test_the_covariance_is_calibrated() -> None:
    chi = []
    for seed in range(60):
        poses = seen(CAMERAS, objects(4, seed))
        cam, views = tables(scattered(poses, seed))
        start = statements(cam, views, [(0, ALONE)]).cam_T_view[:, 0]
        found, covariance, _ = fit_motion(start, cam, views, np.ones((4, 4), bool), [ALONE] * 4)
        error = TRUE @ invert(found)
        twist = np.concatenate([error[:, :3, 3], rotation_vector(error[:, :3, :3])], axis=1)
        chi += np.einsum("mi,mij,mj->m", twist, np.linalg.inv(covariance), twist).tolist()
    assert 0.75 < np.median(chi) / 5.35 < 1.5


def test_no_object_states_nothing() -> None:
    cam, views = tables(seen(CAMERAS, objects(2)))
    stated = statements(cam, views, [])
    assert stated.cam_T_view.shape == (4, 0, 4, 4)
    best, count = medoid(stated, stated.present, np.zeros((4, 3)), (0.01, 0.05))
    assert best.tolist() == [0] * 4 and count.shape == (4, 0)
    assert transform(np.eye(3), np.zeros(3)).shape == (4, 4)


def angle_between(a: ndarray, b: ndarray) -> float:
    return float(np.arccos(np.clip((np.trace(a[:3, :3].T @ b[:3, :3]) - 1) / 2, -1, 1)))


def test_the_medoid_is_its_definition() -> None:
    """The statement with the least sum, over objects, of the nearest statement of each."""
    scale = (0.02, 0.1)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        poses = seen(CAMERAS, objects(5, seed))
        poses[1:, 4, :3, 3] += rng.normal(0, 0.05, (4, 3))  # moved, and turned
        poses[1:, 3, :3, :3] = poses[1:, 3, :3, :3] @ rotation_from_vector(rng.normal(size=3))
        cam, views = tables(scattered(poses, seed))
        symmetries = [HALF_TURN, ALONE, HALF_TURN, ALONE, ALONE]
        stated = statements(cam, views, list(enumerate(symmetries)))
        allowed = rng.random(stated.present.shape) < 0.8
        allowed[:, 0] = True
        at = views.cam_T_obj[..., :3, 3].mean(axis=1)
        best, count = medoid(stated, allowed, at, scale)
        for m in range(4):
            total, agreeing = [], []
            for h in range(len(stated.owner)):
                mine = stated.cam_T_view[m, h]
                costs: dict[int, list[float]] = {}
                agrees: dict[int, bool] = {}
                for other, owner in enumerate(stated.owner.tolist()):
                    its = stated.cam_T_view[m, other]
                    apart = np.linalg.norm((mine - its)[:3] @ [*at[m], 1.0])
                    turned = angle_between(mine, its)
                    cost = np.log1p(3 * (apart / scale[0] + turned / scale[1]))
                    counts = bool(allowed[m, other])
                    costs.setdefault(owner, []).append(cost if counts else np.log1p(1e3))
                    near = counts and apart <= scale[0] and turned <= scale[1]
                    agrees[owner] = agrees.get(owner, False) or near
                total.append(sum(map(min, costs.values())) if allowed[m, h] else np.inf)
                agreeing.append(sum(agrees.values()) if allowed[m, h] else 0)
            assert best[m] == np.argmin(total)
            assert count[m].tolist() == agreeing


def objective(
    motion: ndarray, cam: ObjectPoses, views: ObjectPoses, m: int, allowed: ndarray
) -> float:
    """Cauchy's loss of the squared Mahalanobis distances, of six degrees of freedom."""
    total = 0.0
    for o in np.flatnonzero(allowed):
        carried = motion @ views.cam_T_obj[m, o]
        shift = carried[:3, 3] - cam.cam_T_obj[o, :3, 3]
        distance = shift @ shift / (2 * SIZES[0] ** 2)
        distance += angle_between(carried, cam.cam_T_obj[o]) ** 2 / (2 * SIZES[1] ** 2)
        total += 3.0 * np.log1p(distance / 6.0)
    return total


def test_the_fit_has_the_least_cauchy_loss() -> None:
    for seed in range(4):
        poses = seen(CAMERAS, objects(5, seed))
        poses[1:, 4, :3, 3] += [0.0, 0.02, 0.01]  # neither near nor far: it has half a say
        cam, views = tables(scattered(poses, seed))
        allowed = np.ones((4, 5), bool)
        allowed[:, seed] = False
        start = statements(cam, views, [((seed + 1) % 4, ALONE)]).cam_T_view[:, 0]
        found, covariance, _ = fit_motion(start, cam, views, allowed, [ALONE] * 5)
        for m in range(4):
            least = objective(found[m], cam, views, m, allowed[m])
            sd = np.sqrt(np.diag(covariance[m]))
            for axis in range(6):
                for sign in (-1.0, 1.0):
                    step = np.zeros(6)
                    step[axis] = sign * 0.1 * sd[axis]
                    turn = transform(rotation_from_vector(step[3:]), step[:3])
                    assert objective(turn @ found[m], cam, views, m, allowed[m]) > least


def test_distances_are_those_of_the_fitted_motion() -> None:
    cam, views = tables(scattered(seen(CAMERAS, objects(4)), 3))
    allowed = np.ones((4, 4), bool)
    found, _, distance = fit_motion(TRUE, cam, views, allowed, [ALONE] * 4)
    for m in range(4):
        for o in range(4):
            one = np.arange(4) == o
            loss = objective(found[m], cam, views, m, one)
            assert distance[m, o] == pytest.approx(6 * np.expm1(loss / 3), rel=1e-5)


def test_agreement_is_up_to_the_symmetries() -> None:
    poses = seen(CAMERAS, objects(2))
    cam, views = tables(poses)
    stated = statements(cam, views, [(1, ALONE)])
    turned_views = views.cam_T_obj[:, 0] @ HALF_TURN[1]
    shift = np.array([0.003, 0.004, 0.0])
    moved = cam.cam_T_obj[0].copy()
    moved[:3, 3] += shift
    moved[:3, :3] = moved[:3, :3] @ rotation_from_vector(np.array([0.1, 0.0, 0.0]))
    apart, angle = agreement(stated, moved, turned_views, HALF_TURN)
    np.testing.assert_allclose(apart, 0.005, atol=1e-9)
    np.testing.assert_allclose(angle, 0.1, atol=1e-6)
    _, alone = agreement(stated, moved, turned_views, ALONE)
    assert (alone > 3.0).all()
