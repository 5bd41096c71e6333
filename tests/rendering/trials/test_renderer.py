from __future__ import annotations

import pytest

from graspcast.rendering.trials.renderer import SceneRenderer
from graspcast.simulation.trial.recording import Recording
from graspcast.simulation.trial.trial import TrialRunner


def test_a_closed_renderer_draws_no_more(runner: TrialRunner, held: Recording) -> None:
    drawing = SceneRenderer(runner.grasp_object, runner.gripper, width=64, height=64)
    view = drawing.close_up(held.states[0])
    drawing.close()
    drawing.close()
    with pytest.raises(ValueError, match="closed"):
        drawing.image(held.states[0], view)
