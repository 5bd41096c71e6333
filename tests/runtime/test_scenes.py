"""Scenes that are kept, and those that have ended."""

from __future__ import annotations

import os
import threading

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


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes do not fork here")
def test_a_fork_does_not_wait_for_a_look_of_another_thread() -> None:
    scenes = Scenes(2, 100.0)
    scenes.add("a", Scene([Frame({})]))
    held, done = threading.Event(), threading.Event()

    def look() -> None:
        with scenes._lock, scenes._kept["a"][1].lock:
            held.set()
            done.wait(30)

    thread = threading.Thread(target=look)
    thread.start()
    held.wait(30)
    child = os.fork()
    if child == 0:
        free = scenes.get("a").lock.acquire(timeout=5)
        os._exit(0 if free else 1)
    assert os.waitpid(child, 0)[1] == 0
    done.set()
    thread.join()


def test_why_an_episode_ended_is_remembered_of_the_last_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("graspcast.runtime.scenes._REMEMBERED", 2)
    scenes = Scenes(5, 100.0)
    for name in ("a", "b", "c"):
        scenes.add(name, Scene([Frame({})]))
        scenes.forget(name)
    with pytest.raises(UnknownEpisodeError, match="a is not known here"):
        scenes.forget("a")
    with pytest.raises(UnknownEpisodeError, match="c was forgotten"):
        scenes.get("c")
