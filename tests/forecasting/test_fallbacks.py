"""Models that stand in for one another: the most supporters win, and nothing is guessed."""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest

import one_estimator
import synthetic
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.alignment import Estimates
from graspcast.forecasting.fallbacks import Fallbacks
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings
from graspcast.forecasting.train import train_forecaster

NAMES = ("a", "b", "c", "e")


def forecaster_of(*names: str, **changes: str) -> Forecaster:
    samples = synthetic.tried(60, names=NAMES)
    mine = dataclasses.replace(samples.only(*names), **changes)
    mine = dataclasses.replace(mine, success=np.tile(samples.own_success, (len(names), 1)))
    quick = NetworkSettings(members=1, optimiser=MlpSettings(epochs=40))
    return train_forecaster(mine, method="MLP-O", settings=quick)


@pytest.fixture(scope="module")
def forecasters() -> dict[str, Forecaster]:
    return {names: forecaster_of(*names) for names in ("ab", "ac", "abc", "abce")}


def instance(i: int = 3) -> dict[str, np.ndarray]:
    given = synthetic.estimates(8, seed=4, names=NAMES)
    return {name: given.of(name)[i] for name in NAMES}


def test_the_model_with_the_most_supporters_that_are_there_answers(
    forecasters: dict[str, Forecaster],
) -> None:
    models = Fallbacks(forecasters.values())
    assert [len(model.card.supporters) for model in models] == [3, 2, 1, 1]
    poses = instance()
    for count in range(4):
        for others in combinations("bce", count):
            given = {"a": poses["a"], **{name: poses[name] for name in others}}
            fits = [n for n in ("abce", "abc", "ab", "ac") if set(n) <= set(given)]
            if not fits:
                with pytest.raises(MismatchError):
                    models.predict(given, "d-1")
                continue
            expected = forecasters[fits[0]].predict(given, "d-1")
            by = f"; with {', '.join(fits[0][1:])}" if len(fits) > 1 else ""
            found = models.predict(given, "d-1")
            assert found == replace(expected, reason=expected.reason + by)
            assert [f.card.supporters for f in models.usable(given)] == [
                forecasters[n].card.supporters for n in fits
            ]


@pytest.mark.parametrize("hole", [float("nan"), float("inf")])
def test_a_pose_that_is_not_finite_is_missing(
    forecasters: dict[str, Forecaster], hole: float
) -> None:
    models = Fallbacks(forecasters.values())
    poses = instance()
    broken = poses["c"].copy()
    broken[1, 3] = hole
    without = {name: pose for name, pose in poses.items() if name != "c"}
    found = models.predict(poses | {"c": broken}, "d-1", threshold=0.2)
    expected = forecasters["ab"].predict(without, "d-1", threshold=0.2)
    assert found == replace(expected, reason=f"{expected.reason}; with b")


@pytest.mark.parametrize("change", ["none", "behind", "copy"])
def test_a_pose_that_is_not_sane_is_none_and_if_all_models_lack_one_the_verdict_is_to_abstain(
    forecasters: dict[str, Forecaster], change: str
) -> None:
    models = Fallbacks([forecasters["abc"], forecasters["ab"]])
    poses = instance()
    behind = np.diag([1.0, -1, -1, 1]) @ poses["c"]
    bad = {"none": None, "behind": behind, "copy": poses["a"]}[change]
    found = models.predict(poses | {"c": bad}, "d-1", threshold=0.0)
    assert found.probability == forecasters["ab"].predict(poses, "d-1").probability
    assert found.reason.endswith("; with b")
    found = models.predict(poses | {"b": bad, "c": bad}, "d-1", threshold=0.0)
    assert (found.attempt, found.probability) == (False, None)


def test_what_is_missing_is_named_and_nothing_is_guessed(
    forecasters: dict[str, Forecaster],
) -> None:
    models = Fallbacks([forecasters["abc"], forecasters["ac"]])
    poses = instance()
    says = "no estimates by c for the model with 2; nor by c for the model with 1"
    with pytest.raises(MismatchError, match=f"{says}.*given: a, b"):
        models.predict({"a": poses["a"], "b": poses["b"]}, "d-1")
    with pytest.raises(MismatchError, match=r"by a, b, c for the model with 2; .*given: none"):
        models.predict({}, "d-1")
    with pytest.raises(MismatchError, match="by a for the model"):
        models.usable(("b", "c"))


def test_models_that_cannot_stand_in_for_one_another(forecasters: dict[str, Forecaster]) -> None:
    with pytest.raises(InputError, match="at least one model is needed"):
        Fallbacks([])
    with pytest.raises(InputError, match=r"two models are for a with b, c"):
        Fallbacks([forecasters["abc"], forecaster_of("a", "c", "b")])
    other = forecaster_of("a", "b", gripper="hand")
    with pytest.raises(MismatchError, match="for a and the hand gripper cannot stand in for one"):
        Fallbacks([forecasters["abc"], other])
    with pytest.raises(MismatchError, match="a model for b and the parallel gripper"):
        Fallbacks([forecasters["abc"], forecaster_of("a", "b", principal="b")])


def test_the_principal_alone_stands_in_if_it_was_trained(
    forecasters: dict[str, Forecaster],
) -> None:
    data = one_estimator.seen().data
    alone = replace(data, gripper=forecasters["ab"].card.gripper)
    with pytest.warns(match="one estimator"):
        single = train_forecaster(alone, forests=ForestSettings(trees=8, folds=0))
    models = Fallbacks([single, forecasters["abc"]])
    poses = instance()
    assert [len(model.card.supporters) for model in models] == [2, 0]
    expected = single.predict({"a": poses["a"]}, "d-1", score=0.5)
    for others in ({}, {"b": None, "c": poses["c"]}):
        found = models.predict({"a": poses["a"], **others}, "d-1", score=0.5)
        assert found.probability == expected.probability
        assert "one view of one estimator" in found.reason
    together = models.predict({name: poses[name] for name in "abc"}, "d-1")
    assert "one estimator" not in together.reason
    with pytest.raises(InputError, match="two models are for a with no supporter"):
        Fallbacks([single, single])


@pytest.mark.ill_typed
def test_a_model_of_which_no_instance_has_all_poses_is_passed_over_and_noted(
    forecasters: dict[str, Forecaster],
) -> None:
    class Given:
        """Inputs in which no instance has poses by all four."""

        estimators, models = NAMES, None

        def __init__(self) -> None:
            self.notes: list[str] = []

        def estimates(self, principal: str, *, only: tuple[str, ...]) -> Estimates:
            if len(only) == 4:
                raise MismatchError("no instance has poses by all of a, b, c, e")
            return synthetic.estimates(8, seed=4, names=only)

    given: Any = Given()
    rows = Fallbacks(forecasters.values()).verdict_rows(given, threshold=0.2)
    assert given.notes == ["no instance has poses by all of a, b, c, e"]
    assert len(rows) == 8 and all("; with b, c" in row.verdict.reason for row in rows)
    with pytest.raises(MismatchError, match="no instance has poses by all of a, b, c, e"):
        Fallbacks([forecasters["abce"]]).verdict_rows(Given(), threshold=0.2)  # type: ignore[arg-type]
