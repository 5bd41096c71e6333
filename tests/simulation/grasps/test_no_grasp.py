"""Objects of which there is no grasp, and what is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from bricks import brick
from graspcast.errors import InputError
from graspcast.simulation.grasps.proposing import propose_grasps
from graspcast.simulation.grasps.ranking import Effort
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.types import GraspObject
from solids import box, sphere

FEW = Effort(candidates=12, first_errors=2, parents=1, variations=1, jitter=1, final=1)
EXACT = np.tile(np.eye(4), (4, 1, 1))


def _why(thing: GraspObject, gripper: str = "parallel") -> str:
    with pytest.raises(InputError) as raised:
        propose_grasps(thing, load_gripper(gripper), EXACT, effort=FEW, workers=1)
    return str(raised.value)


def _block(x: float, y: float, z: float) -> GraspObject:
    mesh = trimesh.creation.box(extents=(x, y, z))
    thing = box(x, y, z)
    return replace(thing, vertices=np.array(mesh.vertices), faces=np.array(mesh.faces))


@pytest.mark.slow
def test_a_box_that_is_too_wide() -> None:
    said = _why(_block(0.09, 0.1, 0.12))
    assert "90 mm wide in its narrowest direction, too wide by 12.0 mm" in said
    assert "opening of 80 mm" in said and "too wide" in said


@pytest.mark.slow
def test_a_thin_plate_on_the_table() -> None:
    said = _why(_block(0.12, 0.12, 0.002))
    assert "the table is in the way" in said
    assert "another gripper" in said


@pytest.mark.slow
def test_a_slippery_ball() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    thing = replace(
        sphere(0.06, friction=0.02, mass_kg=2.0),
        vertices=np.array(mesh.vertices),
        faces=np.array(mesh.faces),
    )
    said = _why(thing)
    assert "too slippery" in said and "0.02" in said


def test_what_there_must_be() -> None:
    with pytest.raises(InputError, match="no mesh"):
        propose_grasps(box(), load_gripper("parallel"), EXACT)
    with pytest.raises(InputError, match="no pose errors"):
        propose_grasps(brick(), load_gripper("parallel"), EXACT[:0])
    with pytest.raises(InputError, match="at least 1"):
        propose_grasps(brick(), load_gripper("parallel"), EXACT, count=0)
