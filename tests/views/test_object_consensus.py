"""The motion that objects in two images state together."""

from __future__ import annotations

import numpy as np
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
