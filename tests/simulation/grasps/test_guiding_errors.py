from __future__ import annotations

import numpy as np
import pytest

from bricks import brick
from graspcast.errors import MismatchError
from graspcast.simulation.campaign.pose_errors import PoseErrors
from graspcast.simulation.grasps.guiding_errors import guiding_errors


def _on(name: str, count: int, shift: float) -> PoseErrors:
    truth = np.tile([0.0, 0.0, shift, 0.0, 0.0, 0.0], (count, 1))
    return PoseErrors(np.full(count, name), np.ones(count), truth, {"mine": "mine.csv"})


def test_the_default_is_stated() -> None:
    found = guiding_errors(brick(), count=4000)
    assert "4 mm across and 10 mm along" in found.told and "Student" in found.told
    shift = found.obj_T_est[:, :3, 3]
    assert np.sqrt((shift**2).sum(axis=1).mean()) == pytest.approx(0.0115, rel=0.15)
    again = guiding_errors(brick(), count=4000)
    assert np.array_equal(again.obj_T_est, found.obj_T_est)


def test_objects_are_seen_from_above() -> None:
    # The truth is farther away than the estimate, so the estimates are on the side of the camera.
    found = guiding_errors(brick(), _on("", 50, 0.01), count=500)
    shift = found.obj_T_est[:, :3, 3]
    assert np.allclose(np.linalg.norm(shift, axis=1), 0.01)
    assert np.all(shift[:, 2] > 0) and shift[:, 2].min() < 0.001 and shift[:, 2].max() > 0.0095


def test_errors_on_the_object_itself_come_first() -> None:
    one, other = _on("box", 40, 0.01), _on("lmo-1", 40, 0.02)
    both = PoseErrors(
        np.concatenate([one.objects, other.objects]),
        np.ones(80),
        np.concatenate([one.truth, other.truth]),
        {"mine": "mine.csv"},
    )
    found = guiding_errors(brick(), both, count=20)
    assert found.told == "those of mine, made on box"
    assert np.allclose(np.linalg.norm(found.obj_T_est[:, :3, 3], axis=1), 0.01)
    found = guiding_errors(brick(), other, count=20)
    assert found.told.endswith("made on other objects")


def test_too_few_errors_of_the_only_object() -> None:
    with pytest.raises(MismatchError, match="5 errors of estimates of box and none of other"):
        guiding_errors(brick(), _on("box", 5, 0.01))
