"""Nothing is left of a rehearsal."""

from __future__ import annotations

from pathlib import Path

from episode_world import new_world
from graspcast import Watcher
from graspcast.runtime.judging import Judge
from graspcast.runtime.rehearsal import rehearse


def test_a_rehearsal_takes_looks_and_keeps_nothing(tmp_path: Path, monkeypatch: object) -> None:
    world = new_world(tmp_path)
    taken = []

    class Counting(Judge):
        def look(self, episodes, frame):  # type: ignore[no-untyped-def]
            taken.append(len(frame))
            return super().look(episodes, frame)

    rehearse(Counting(world.forecaster, None))
    assert taken == [3, 3]
    watcher = Watcher(world.forecaster)
    watcher.warm_up()
    assert "0 episodes" in repr(watcher)
