"""Several looks at all of a scene."""

from __future__ import annotations

import numpy as np
import pytest

from episode_world import FOUND, World, new_world, poses, results
from looked_at import CAMERAS, NAMES
from static_scenes import estimates_of, objects, scattered, seen


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return new_world(tmp_path_factory.mktemp("world"))


def test_all_objects_keep_their_numbers(world: World) -> None:
    episodes = world.episodes(guide="fused")
    first, second = (episodes.look(results(i), CAMERAS[i]) for i in range(2))
    assert [(v.instance, v.object_name) for v in first] == [(0, "d-1"), (1, "d-2")]
    assert [(v.instance, v.object_name) for v in second] == [(0, "d-1"), (1, "d-2")]
    assert [v.views for v in second] == [2, 2]
    alone = world.episode(guide="fused")
    for i in range(2):
        verdict = alone.look(poses(i), CAMERAS[i])
    assert second[1].probability == pytest.approx(verdict.probability, abs=1e-9)
    assert second[1].row is not None
    assert second[1].row.key == ("d", 1, 1, 2, 0)
    assert episodes.look({}, CAMERAS[2]) == []
    assert repr(episodes) == "Episodes(d, 3 looks)"


def test_two_instances_of_an_object_are_kept_apart(world: World) -> None:
    both = objects(2, 77)
    both[1, :3, 3] = both[0, :3, 3] + [0.25, 0, 0]
    true = seen(CAMERAS, both)
    episodes = world.episodes()
    where: dict[int, list[np.ndarray]] = {}
    for i in range(3):
        order = [0, 1] if i != 1 else [1, 0]
        tables = {
            name: estimates_of(scattered(true, 40 + k)[i : i + 1, order], obj_ids=(1, 1))
            for k, name in enumerate(NAMES)
        }
        for verdict in episodes.look(tables, CAMERAS[i]):
            assert verdict.world_T_obj is not None
            where.setdefault(verdict.instance, []).append(verdict.world_T_obj[:3, 3])
    assert sorted(where) == [0, 1]
    for places in where.values():
        assert np.ptp(np.stack(places), axis=0).max() < 0.1


def test_objects_that_are_not_known_are_abstained_from(world: World) -> None:
    tables = {name: estimates_of(found[:1], obj_ids=(7, 8)) for name, found in FOUND.items()}
    found = world.episodes().look(tables, CAMERAS[0])
    assert [str(v) for v in found] == ["abstain", "abstain"]
    assert "not trained for d-7" in found[0].reason
