from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from graspcast.bop.models import ContinuousSymmetry, read_models_info
from graspcast.bop.models_writing import diameter, info_entry, update_models_info
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
