"""One forecaster at the robot."""

from __future__ import annotations

from dataclasses import replace

import pytest

from episode_world import World, new_world
from graspcast.errors import InputError, MismatchError
from graspcast.runtime.judging import Judge


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return new_world(tmp_path_factory.mktemp("world"))


def test_options_are_checked_before_a_frame_comes(world: World) -> None:
    Judge(world.forecaster, world.models, threshold=0.5)
    with pytest.raises(InputError, match="threshold is a probability"):
        Judge(world.forecaster, world.models, threshold=1.5)


def test_what_an_old_model_file_lacks_is_said_with_the_remedies(world: World) -> None:
    old = replace(world.forecaster, known=None)
    with pytest.raises(MismatchError, match=r"none of d-1, d-2: give the object models, or train"):
        Judge(old, None)
    assert Judge(old, world.models).grasps_of("d-1") == {}


def test_the_models_that_are_given_come_before_those_of_the_file(world: World) -> None:
    assert Judge(world.forecaster, world.models).models is world.models
    own = Judge(world.forecaster, None).models
    assert own is not None and own["d"][1].diameter_m == world.models["d"][1].diameter_m
