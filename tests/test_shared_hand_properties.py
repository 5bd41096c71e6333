"""The geometric model of trials with which shared properties of the hands are compared."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import trimesh

from graspcast.simulation.grasps.sampling import LabelledTrials
from graspcast.simulation.objects.types import GraspObject
from solids import box, from_above
from trials import GRIPPERS, moved

DEEP = {"parallel": 0.04, "underactuated": 0.07}


@pytest.fixture(scope="module")
def properties() -> ModuleType:
    sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
    import shared_hand_properties

    return shared_hand_properties


def cube() -> GraspObject:
    mesh = trimesh.creation.box(extents=(0.06, 0.06, 0.06))
    return replace(box(), vertices=np.array(mesh.vertices), faces=np.array(mesh.faces))


@pytest.mark.parametrize("gripper", GRIPPERS)
def test_a_grasp_succeeds_where_something_is_between_the_fingers_and_none_of_it_in_the_hand(
    properties: ModuleType, gripper: str
) -> None:
    target = cube()
    errors = np.stack([moved(), moved(z=-DEEP[gripper]), moved(z=0.1), moved(x=0.025)])
    trials = LabelledTrials(errors, np.array([True, False, False, False]))
    grasp = from_above(target, 0.02 if gripper == "parallel" else -0.01)
    aside = [False] if gripper == "parallel" else []
    blocked, free = [True, False, False, *aside], [True, True, False]
    for tolerance_m, expected in ((0.002, blocked), (1.0, free)):
        candidate = properties.Candidate(gripper, tolerance_m=tolerance_m)
        parallel = gripper == "parallel"
        shape = properties.franka(candidate) if parallel else properties.tendon_hand(target)
        model = properties.Model(target, candidate, shape, 4000)
        found, _, agreed = model.predict(grasp, trials, None if parallel else (3, 0.02))
        assert found.tolist()[: len(expected)] == expected
        assert agreed.accuracy == np.mean(found == trials.success)


def test_the_search_moves_a_grasp_to_where_it_agrees(properties: ModuleType) -> None:
    target, rng = cube(), np.random.default_rng(0)
    shifts = rng.uniform(-0.03, 0.03, size=40)
    errors = np.stack([moved(z=z) for z in shifts])
    trials = LabelledTrials(errors, np.abs(shifts) < 0.01)
    model = properties.Model(target, properties.FRANKA, properties.franka(properties.FRANKA), 400)
    start = from_above(target, 0.025)
    before = properties.objective(model.predict(start, trials, None)[2])
    best, tried = properties.search(model, target, trials, start, 4)
    assert properties.objective(model.predict(best, trials, None)[2]) > before
    assert tried > 40
