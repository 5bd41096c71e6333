from __future__ import annotations

import pytest

from episode_world import World, new_world
from graspcast.runtime.watcher import Watcher
from graspcast.service.answers import ModelsOut
from graspcast.service.models import models_of
from graspcast.service.replies import json_reply
from looked_at import NAMES


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return new_world(tmp_path_factory.mktemp("world"))


def test_models_are_told_with_their_policy(world: World) -> None:
    watcher = Watcher(
        world.forecaster, models=world.models, threshold=0.7, guide="fused", max_looks=2
    )
    told = ModelsOut.model_validate_json(json_reply(models_of(watcher)).body, strict=True)
    (model,) = told.models
    assert model.digest == world.forecaster.card.digest
    assert (model.threshold, model.guarantee, model.guide, model.max_looks) == (
        0.7, None, "fused", 2,
    )  # fmt: skip
    assert sorted([model.principal, *model.supporters]) == sorted(told.estimators) == sorted(NAMES)
    assert model.objects["d-1"] == ["reference"]
    assert not told.records
