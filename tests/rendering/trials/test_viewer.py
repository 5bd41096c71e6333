from __future__ import annotations

import contextlib
import sys
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from graspcast.rendering.trials.viewer import replay
from graspcast.simulation.trial.recording import Recording
from graspcast.simulation.trial.trial import TrialRunner


class _Window:
    """Stands where MuJoCo's viewer needs a display, and is closed after some pictures."""

    def __init__(self, model: object, data: mujoco.MjData):
        self.data, self.heights = data, []
        self.cam = mujoco.MjvCamera()

    def __enter__(self) -> _Window:
        return self

    def __exit__(self, *_: object) -> None:
        self.closed = True

    def lock(self) -> contextlib.AbstractContextManager[None]:
        return contextlib.nullcontext()

    def is_running(self) -> bool:
        return len(self.heights) < 20

    def sync(self) -> None:
        self.heights.append(float(self.data.body("hand").xpos[2]))


def test_the_viewer_plays_the_recording(
    runner: TrialRunner, held: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    windows: list[_Window] = []

    def launch_passive(model: object, data: mujoco.MjData, **_: object) -> _Window:
        windows.append(_Window(model, data))
        return windows[0]

    monkeypatch.setitem(
        sys.modules, "mujoco.viewer", SimpleNamespace(launch_passive=launch_passive)
    )
    monkeypatch.setattr(mujoco, "viewer", sys.modules["mujoco.viewer"], raising=False)
    replay(held, runner.grasp_object, runner.gripper)
    heights = windows[0].heights
    assert windows[0].closed and len(heights) == 20
    assert (np.diff(heights) < 0).all()  # the approach, from above
