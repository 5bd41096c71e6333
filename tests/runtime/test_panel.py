"""Where a supporter is missing, the model that does without it answers."""

from __future__ import annotations

from pathlib import Path

import pytest

from episode_world import FOUND, World, new_world
from graspcast import Estimate, Forecaster, Frame, Watcher
from looked_at import CAMERAS, NAMES, trained


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return new_world(tmp_path_factory.mktemp("world"))


@pytest.fixture(scope="module")
def fewer(tmp_path_factory: pytest.TempPathFactory) -> Forecaster:
    with pytest.warns(match="not calibrated"):
        forecaster, _ = trained(tmp_path_factory.mktemp("fewer"), names=NAMES[:2])
    return forecaster


def frame(i: int, *, without: str = "") -> Frame:
    estimates = {
        name: [
            Estimate(f"d-{o + 1}", FOUND[name][i, o]) for o in range(2) if name != without or not o
        ]
        for name in NAMES
    }
    return Frame(estimates, CAMERAS[i])


def test_a_missing_supporter_is_done_without(world: World, fewer: Forecaster) -> None:
    watcher = Watcher(world.forecaster, fewer, threshold=0.5)
    alone, whole = Watcher(fewer, threshold=0.5), Watcher(world.forecaster, threshold=0.5)
    given = frame(0, without="c")
    first, second = watcher.judge(given)
    assert first.probability == whole.judge(given).decisions[0].probability
    assert first.reason.endswith("with b, c")
    assert whole.judge(given).decisions[1].probability is None
    two = Frame({name: given.estimates[name] for name in NAMES[:2]}, CAMERAS[0])
    assert second.probability == alone.judge(two).decisions[1].probability
    assert second.reason.endswith("with b")
    assert (first.instance, second.instance) == (0, 1)


def test_further_looks_are_judged_by_both_too(world: World, fewer: Forecaster) -> None:
    watcher = Watcher(world.forecaster, fewer, threshold=0.5)
    episode = watcher.judge(frame(0)).episode
    watcher.judge(frame(1, without="c"), episode)
    third = watcher.judge(frame(2, without="c"), episode)
    assert [d.instance for d in third] == [0, 1]
    assert all(d.probability is not None and d.looks == 3 for d in third)


def test_where_the_principal_is_missing_it_is_abstained_from(
    world: World, fewer: Forecaster
) -> None:
    watcher = Watcher(world.forecaster, fewer)
    found = watcher.judge(frame(0, without="a"))
    assert found.decisions[1].probability is None
    assert "no estimate by a" in found.decisions[1].reason
    assert found.decisions[1].action != "attempt"


def test_what_is_wrong_in_the_file_of_a_log_is_found_there(
    world: World, fewer: Forecaster, tmp_path: Path
) -> None:
    from graspcast.attempt_log.log import AttemptLog

    with AttemptLog.open(tmp_path / "log.db") as log:
        watcher = Watcher(world.forecaster, fewer, log=log, threshold=0.5)
        watcher.judge(frame(0, without="c"))
        models = log.decisions()["model"].to_list()
    assert models == [world.forecaster.card.digest, fewer.card.digest]
