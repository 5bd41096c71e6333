from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from graspcast.errors import MismatchError
from graspcast.pose.transforms import exp
from graspcast.simulation.grippers import FrankaHand
from graspcast.simulation.trial.trial import TrialRunner
from solids import raised
from trials import nail


def test_an_object_that_does_not_rest_is_refused() -> None:
    tilted = raised(0.07) @ exp(np.array([0, 0, 0, 0.4, 0, 0]))
    for pose in (raised(0.2), raised(-0.1), tilted):
        with pytest.raises(MismatchError, match="does not rest in its reference pose"):
            TrialRunner(replace(nail(), sim_T_ref=pose), FrankaHand())
