from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bricks import brick
from graspcast.pose.transforms import compose, invert
from graspcast.simulation.grasps.candidates import candidates_of
from graspcast.simulation.grasps.proposals import OpenHand
from graspcast.simulation.grasps.trial_pool import TrialPool
from graspcast.simulation.grippers import load_gripper


@pytest.mark.parametrize(
    "name", ["parallel", pytest.param("underactuated", marks=pytest.mark.slow)]
)
def test_the_open_hand_is_clear_at_every_candidate(name: str) -> None:
    gripper, thing = load_gripper(name), brick()
    pool = TrialPool(thing, gripper, workers=1)
    found = candidates_of(pool, OpenHand.of(pool.scene, gripper), np.random.default_rng(0))
    assert len(found) > 100 and set(found.origin) == {"antipodal", "enclosing"}
    assert found.rejected["table"] and found.rejected["object"]
    for pose in found.obj_T_grasp[::7]:
        sim_T_base = compose(thing.sim_T_ref, pose, invert(gripper.base_T_tcp))
        for before in (0.0, -0.05, -0.1):
            pool.scene.place(sim_T_base, before)
            assert not pool.scene.hand_in_contact()


@pytest.mark.slow
def test_what_is_too_wide_is_counted_and_measured() -> None:
    gripper = load_gripper("parallel")
    cube = replace(brick(), vertices=brick().vertices * 0.09 / np.ptp(brick().vertices, axis=0))
    pool = TrialPool(cube, gripper, workers=1)
    found = candidates_of(pool, OpenHand.of(pool.scene, gripper), np.random.default_rng(0))
    assert "antipodal" not in found.origin
    assert found.narrowest_m == pytest.approx(0.09, abs=1e-4)
    assert found.rejected["too wide"] > 500
