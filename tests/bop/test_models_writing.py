from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from graspcast.bop.models import ContinuousSymmetry, read_models_info
from graspcast.bop.models_writing import diameter, extreme_points, info_entry, update_models_info
from graspcast.errors import FormatError
from graspcast.pose.transforms import rotation_from_vector, transform

BOX = np.array(trimesh.creation.box((0.1, 0.06, 0.04)).vertices) + [0.01, 0, 0]


def test_an_entry_is_read_as_it_was_written(tmp_path: Path) -> None:
    flip = rotation_from_vector(np.array([np.pi, 0, 0]))
    poses = transform(flip, np.array([0.0, 0.002, 0.0]))[None]
    axis = ContinuousSymmetry(np.array([1.0, 0, 0]), np.array([0.0, 0.001, 0]))
    path = tmp_path / "models_info.json"
    update_models_info(path, {3: info_entry(BOX, poses, [axis])})
    info = read_models_info(path)[3]
    assert info.diameter_m == pytest.approx(np.linalg.norm([0.1, 0.06, 0.04]))
    np.testing.assert_allclose(info.lower, [-0.04, -0.03, -0.02])
    np.testing.assert_allclose(info.size, [0.1, 0.06, 0.04])
    np.testing.assert_allclose(info.discrete, poses, atol=1e-12)
    np.testing.assert_allclose(info.continuous[0].axis, axis.axis)
    np.testing.assert_allclose(info.continuous[0].offset, axis.offset)


def test_other_objects_stay_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "models_info.json"
    other = {**info_entry(BOX), "made_by": "someone"}
    path.write_text(json.dumps({"10": other, "2": other}))
    update_models_info(path, {3: info_entry(BOX)})
    read = json.loads(path.read_text())
    assert list(read) == ["2", "3", "10"] and read["10"] == other
    path.write_text("[]")
    with pytest.raises(FormatError):
        update_models_info(path, {3: info_entry(BOX)})
    assert path.read_text() == "[]"


def test_diameter_of_a_ball_with_many_corners() -> None:
    ball = np.array(trimesh.creation.icosphere(5, 0.05).vertices)
    assert diameter(ball) == pytest.approx(0.1, rel=1e-3)


@pytest.mark.slow
def test_extreme_points_of_a_large_round_scan_span_its_hull() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(150_000, 3))
    points *= 0.05 / np.linalg.norm(points, axis=1, keepdims=True)
    few = extreme_points(points)
    assert len(few) <= 4000
    directions = rng.normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lost = (points @ directions.T).max(axis=0) - (few @ directions.T).max(axis=0)
    assert lost.max() < 5e-4 * 0.1
    assert len(extreme_points(points[:1000])) == 1000
