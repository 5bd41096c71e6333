from __future__ import annotations

import numpy as np
import pytest

from graspcast.simulation.objects.rest_pose import rest_pose, stable_ups
from graspcast.simulation.objects.types import Primitive


def test_up_need_not_be_exact() -> None:
    box = (Primitive("box", (0.02, 0.03, 0.05), np.eye(4)),)
    straight = rest_pose(box, np.zeros(3), np.array([0, 0, 1.0]), "box")
    np.testing.assert_allclose(straight[2], [0, 0, 1, 0.05], atol=1e-9)
    lying = rest_pose(box, np.zeros(3), np.array([1.0, 0.1, -0.2]), "box")
    np.testing.assert_allclose(lying[2], [1, 0, 0, 0.02], atol=1e-9)


@pytest.mark.parametrize(
    ("piece", "height"),
    [
        (Primitive("cylinder", (0.03, 0.05), np.eye(4)), 0.05),
        (Primitive("sphere", (0.03,), np.eye(4)), 0.03),
        (Primitive("box", (0.01, 0.02, 0.03), np.eye(4)), 0.03),
    ],
)
def test_primitives_touch_the_table_exactly(piece: Primitive, height: float) -> None:
    pose = rest_pose((piece,), np.zeros(3), np.array([0, 0, 1.0]), "it")
    assert pose[2, 3] == pytest.approx(height, rel=1e-9)


def test_a_body_heavy_at_one_end_does_not_stand_on_the_other() -> None:
    box = (Primitive("box", (0.02, 0.02, 0.05), np.eye(4)),)
    ups, heights = stable_ups(box, np.array([0.0, 0.0, -0.04]))
    assert heights.min() == pytest.approx(0.01)
    # Its centroid leans beyond the base, so it cannot stand on that face.
    ups, _ = stable_ups(box, np.array([0.05, 0.0, 0.0]))
    assert not (ups @ [0, 0, 1] > 0.9).any()
