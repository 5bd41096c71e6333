"""One forecaster at the robot."""

from __future__ import annotations

from pathlib import Path

import pytest

from episode_world import new_world
from graspcast.errors import InputError
from graspcast.runtime.judging import Judge


def test_options_are_checked_before_a_frame_comes(tmp_path: Path) -> None:
    world = new_world(tmp_path)
    Judge(world.forecaster, world.models, {"threshold": 0.5}).check()
    with pytest.raises(InputError, match="threshold is a probability"):
        Judge(world.forecaster, world.models, {"threshold": 1.5}).check()
