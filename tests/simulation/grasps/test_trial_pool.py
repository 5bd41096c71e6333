from __future__ import annotations

import numpy as np
import pytest

from bricks import brick, from_top
from graspcast.errors import InputError
from graspcast.pose.transforms import exp
from graspcast.simulation.grasps.trial_pool import TrialPool
from graspcast.simulation.grippers import load_gripper


def test_outcomes_do_not_depend_on_the_number_of_threads() -> None:
    rng = np.random.default_rng(0)
    errors = exp(rng.standard_normal((12, 6)) * np.repeat([0.01, 0.1], 3))
    trials = [(error, from_top(0.02)) for error in errors]
    told = []
    for workers in (1, 3):
        pool = TrialPool(brick(), load_gripper("parallel"), workers=workers)
        told.append([(o.success, o.reason, o.offset_m, o.steps) for o in pool.run(trials)])
        assert pool.trials == 12
    assert repr(told[0]) == repr(told[1])
    assert {success for success, *_ in told[0]} == {True, False}


def test_an_error_of_a_thread_is_raised() -> None:
    pool = TrialPool(brick(), load_gripper("parallel"), workers=2)
    with pytest.raises(ZeroDivisionError):
        pool.map(lambda _, number: 1 / number, [1, 2, 0, 3])
    assert pool.map(lambda _, number: number + 1, [1, 2, 3]) == [2, 3, 4]


def test_there_is_at_least_one_thread() -> None:
    with pytest.raises(InputError, match="at least 1"):
        TrialPool(brick(), load_gripper("parallel"), workers=0)
