"""The constant transform between two sources' poses."""

from __future__ import annotations

import numpy as np

from graspcast.diagnosis.offsets import find_offset, refit_shift
from graspcast.pose.transforms import invert, rotation_angle, rotation_from_vector, transform
from sick_files import healthy

D = transform(rotation_from_vector(np.array([0.3, -0.8, 0.5])), np.array([0.03, -0.01, 0.05]))
ALONE = np.eye(4)[None]


def test_a_transform_is_found_among_outliers() -> None:
    files = healthy()
    poses, truth = files.estimates["a"][1] @ invert(D), files.truth[1]
    poses[:6] = poses[6:12]
    found = find_offset(poses, truth, ALONE, 0.12)
    apart = invert(D) @ found.one_T_other
    assert np.linalg.norm(apart[:3, 3]) < 1.5e-3
    assert rotation_angle(apart[:3, :3]) < np.radians(1.0)
    assert found.before > 5 * found.after
    assert found.agreeing >= 0.7


def test_nothing_where_there_is_nothing() -> None:
    files = healthy()
    found = find_offset(files.estimates["a"][1], files.truth[1], ALONE, 0.12)
    assert found.shift_m < 2e-3
    assert found.before < 1.5 * found.after


def test_symmetric_equivalents_are_one_pose() -> None:
    files = healthy()
    turn = transform(rotation_from_vector(np.array([0, 0, np.pi])), np.zeros(3))
    poses = files.estimates["a"][1].copy()
    poses[::2] = poses[::2] @ turn
    found = find_offset(poses, files.truth[1], np.stack([np.eye(4), turn]), 0.12)
    assert found.after < 0.05
    shift = refit_shift(poses, files.truth[1], np.stack([np.eye(4), turn]), np.eye(3))
    assert np.linalg.norm(shift) < 2e-3
