from __future__ import annotations

import numpy as np
import pytest
import trimesh

from graspcast.bop.meshes import Mesh
from graspcast.errors import InputError
from graspcast.simulation.objects.bodies import bodies_of, check_bodies

create, join = trimesh.creation, trimesh.util.concatenate


def at(size: float, x: float) -> trimesh.Trimesh:
    box = create.box((size, size, size))
    box.apply_translation([x, 0, 0])
    return box


def mesh(*parts: trimesh.Trimesh) -> Mesh:
    joined = join(list(parts))
    return Mesh(np.array(joined.vertices), np.array(joined.faces))


def test_the_largest_body_comes_first() -> None:
    assert bodies_of(mesh(at(0.02, 0), at(0.1, 1))).tolist() == 12 * [1] + 12 * [0]


def test_bodies_that_touch_or_lie_inside_are_one_object_and_said() -> None:
    assert check_bodies("a mug", mesh(at(0.1, 0))) == ""
    assert "2 bodies" in check_bodies("a mug", mesh(at(0.1, 0), at(0.05, 0.07)))
    assert "2 bodies" in check_bodies("a mug", mesh(at(0.1, 0), at(0.02, 0)))


def test_a_body_apart_is_refused() -> None:
    with pytest.raises(InputError, match=r"one of 10 mm lies 95 mm apart from the largest"):
        check_bodies("a mug", mesh(at(0.1, 0), at(0.01, 0.15)))
