from __future__ import annotations

import numpy as np
import pytest

from graspcast.rendering.trials.appearance import Appearance
from graspcast.simulation.trial.recording import Recording
from graspcast.simulation.trial.trial import TrialRunner


def test_what_is_seen_is_where_the_trial_had_it(runner: TrialRunner, held: Recording) -> None:
    seen, state = Appearance(runner.grasp_object, runner.gripper), held.of("close")[-1]
    seen.pose(state)
    scene = runner.scene
    scene.data.qpos[scene.object_qpos] = seen.data.body("object").xpos.tolist() + [1, 0, 0, 0]
    box_middle = seen.data.body("object").xpos
    np.testing.assert_allclose(box_middle, state.sim_T_obj[:3, 3], atol=1e-9)
    pads = [seen.data.geom(f"hand/{side}_pad").xpos for side in ("left", "right")]
    gap = np.linalg.norm(pads[0] - pads[1]) - 2 * 0.00475
    # A cube of 60 mm between the pads, which give way by little.
    assert gap == pytest.approx(0.06, abs=1e-3)
    np.testing.assert_allclose(np.mean(pads, axis=0)[0], box_middle[0], atol=2e-3)
