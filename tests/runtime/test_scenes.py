"""Scenes that are kept, and those that have ended."""

from __future__ import annotations

import pytest

from graspcast.errors import UnknownEpisodeError
from graspcast.runtime.frame import Frame
from graspcast.runtime.scenes import Scene, Scenes


def test_the_episode_not_used_for_longest_makes_room() -> None:
    scenes = Scenes(2, 100.0)
    for name in ("a", "b"):
        scenes.add(name, Scene([Frame({})]))
    scenes.get("a")
    scenes.add("c", Scene([Frame({})]))
    assert len(scenes) == 2
    scenes.get("a")
    with pytest.raises(UnknownEpisodeError, match="episode b made room"):
        scenes.get("b")


def test_a_scene_keeps_its_last_frames_and_numbers() -> None:
    scene = Scene([Frame({})])
    for _ in range(30):
        scene.add(Frame({}))
    assert scene.count == 31 and len(scene.frames) == 20
    assert [scene.number("d", 0), scene.number("e", 0), scene.number("d", 0)] == [0, 1, 0]
