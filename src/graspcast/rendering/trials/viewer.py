"""Playback of a recorded trial in MuJoCo's viewer, in real time, in a loop."""

from __future__ import annotations

import os
import platform
import time
import warnings
from typing import Any

from graspcast.errors import InputError
from graspcast.io.extras import require
from graspcast.rendering.trials.appearance import Appearance
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.types import GraspObject
from graspcast.simulation.trial.recording import Recording

__all__ = ["check_display", "replay"]

_PAUSE_S, _FRAME_S = 1.0, 0.02
_INSTEAD = "write the trial to a .mp4, .gif or .png file instead"


def check_display() -> None:
    """Raise an error if no window can be opened.

    Raises
    ------
    InputError
        If there is no display.
    ExtraMissingError
        If GLFW is not installed.
    """
    on_linux = platform.system() == "Linux"
    if on_linux and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(
            f"there is no display for MuJoCo's viewer; {_INSTEAD}", parameters=("out",)
        )
    require("render")
    import glfw

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        # The viewer would wait forever for a window that cannot be opened.
        opened = glfw.init()
    if not opened:
        why = f" ({caught[-1].message})" if caught else ""
        raise InputError(
            f"MuJoCo's viewer cannot open a window{why}; {_INSTEAD}", parameters=("out",)
        )


def replay(
    recording: Recording, grasp_object: GraspObject, gripper: Gripper, *, collision: bool = False
) -> None:
    """Play a recording in MuJoCo's viewer until its window is closed.

    Raises
    ------
    InputError
        On macOS, if Python was not started as ``mjpython``.
    """
    seen = Appearance(grasp_object, gripper, collision=collision)
    from mujoco import viewer  # once the appearance has imported MuJoCo, checked

    seen.pose(recording.states[0])
    try:
        window = viewer.launch_passive(
            seen.model, seen.data, show_left_ui=False, show_right_ui=False
        )
    except RuntimeError as error:
        raise InputError(
            f"MuJoCo's viewer does not start ({error}); on macOS run Python as mjpython, or "
            f"{_INSTEAD}",
            parameters=("out",),
        ) from error
    with window:
        middle = seen.object_corners.mean(axis=0) + recording.states[0].sim_T_obj[:3, 3]
        window.cam.lookat[:], window.cam.distance = middle, 0.8
        while window.is_running():
            _play_once(recording, seen, window)


def _play_once(recording: Recording, seen: Appearance, window: Any) -> None:
    started = time.perf_counter()
    for state in recording.every(_FRAME_S):
        if not window.is_running():
            return
        with window.lock():
            seen.pose(state, recording.overlay(state))
        window.sync()
        ahead = state.time_s - recording.states[0].time_s - (time.perf_counter() - started)
        time.sleep(max(0.0, ahead))
    time.sleep(_PAUSE_S)
