"""One forecaster at the robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from episode_world import World, new_world
from graspcast.errors import InputError, MismatchError
from graspcast.guarantees.certify import certify
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


def test_a_certificate_of_one_view_serves_where_one_look_is_all(world: World) -> None:
    forecaster = world.forecaster
    assert forecaster.view_model is not None
    found = certify(np.full(40, 0.95), np.ones(40, bool), np.arange(40), rate=0.9, confidence=0.9)
    stated = {"model": forecaster.card.digest, "ood_alpha": 0.01}
    certificate = replace(found, policy=None, provenance=stated)
    options = {"certificate": certificate, "max_views": 3}
    judge = Judge(forecaster, world.models, max_looks=1, **options)
    assert judge.episodes("d").max_views == 1
    with pytest.raises(MismatchError, match="the certificate is of one view"):
        Judge(forecaster, world.models, max_looks=3, **options)
