"""Protocols: no scene, object, gripper, outcome or ground truth of a test leaks into training."""

from __future__ import annotations

import dataclasses

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_allclose

import synthetic
from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.methods import (
    Majority,
)
from graspcast.evaluation.protocols import PROTOCOLS, Task, forecast, tasks
from graspcast.forecasting.training_data import TrainingData
from poses import write_models


@pytest.fixture(scope="module")
def benchmark(tmp_path_factory: pytest.TempPathFactory) -> Benchmark:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={})
    return synthetic.benchmark({"d": Models(folder)})


def keys(estimates: Estimates) -> set[tuple[int, ...]]:
    columns = (estimates.scene_id, estimates.im_id, estimates.obj_id)
    return set(zip(*(c.tolist() for c in columns), strict=True))


def learned(task: Task) -> list[TrainingData]:
    return [task.train, *task.others, *task.simulated]


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_no_test_instance_is_in_training(benchmark: Benchmark, protocol: str) -> None:
    for principal, gripper in benchmark.pairs():
        tested: list[tuple[int, ...]] = []
        for task, test in tasks(benchmark, protocol, principal, gripper):
            assert (test.principal, test.gripper) == (principal, gripper)
            assert task.test is test.estimates
            asked = keys(task.test)
            for samples in learned(task):
                assert not asked & keys(samples.estimates)
            assert not asked & keys(task.annotated)
            with pytest.raises(MismatchError, match="are for testing"):
                task.truth_of(task.test)
            tested += asked
        assert len(tested) == len(set(tested))


@pytest.mark.parametrize("protocol", ["unseen_scenes", "unseen_gripper"])
def test_no_scene_is_on_both_sides(benchmark: Benchmark, protocol: str) -> None:
    every = np.ones(len(benchmark), dtype=bool)
    seen = 0
    for task, test in tasks(benchmark, protocol, "b", "u", rows=every):
        asked = set(benchmark.scenes[benchmark.rows_of(task.test)])
        for given in [s.estimates for s in learned(task)] + [task.annotated]:
            assert not asked & set(benchmark.scenes[benchmark.rows_of(given)])
        seen += len(test)
    assert seen == len(benchmark)


@pytest.mark.parametrize("protocol", ["unseen_object", "unseen_object_simulated"])
def test_nothing_but_simulation_is_known_of_an_unseen_object(
    benchmark: Benchmark, protocol: str
) -> None:
    names = []
    for task, test in tasks(benchmark, protocol, "a", "p"):
        names.append(task.left_out)
        assert set(test.objects) == {task.left_out}
        assert benchmark.reported[benchmark.rows_of(task.test)].all()
        for samples in (task.train, *task.others):
            assert task.left_out not in samples.objects
        assert task.left_out not in task.annotated.objects
        # One's own trials of it are there, on images that are not test.
        assert task.left_out in task.simulated[0].objects
    assert names == ["d-1", "d-2"]


def test_nothing_but_simulation_is_known_of_an_unseen_gripper(benchmark: Benchmark) -> None:
    for task, test in tasks(benchmark, "unseen_gripper", "a", "p"):
        assert task.left_out == test.gripper == task.gripper == "p"
        assert {s.gripper for s in (task.train, *task.others)} == {"u"}
        assert {s.gripper for s in task.simulated} == {"p"}
        assert benchmark.reported[benchmark.rows_of(task.test)].all()


def test_the_split_is_the_one_of_the_principal_and_gripper(benchmark: Benchmark) -> None:
    ((task, test),) = tasks(benchmark, "random_split", "c", "u")
    mine = benchmark.split.filter(pl.col("principal") == "c", pl.col("gripper") == "u")
    assert len(test) == (mine["split"] == "test").sum()
    assert len(task.train) == (mine["split"] == "train").sum()


def test_a_task_has_the_right_outcomes_and_true_poses(benchmark: Benchmark) -> None:
    task, _ = next(iter(tasks(benchmark, "unseen_scenes", "b", "u")))
    assert [task.train.principal, *(s.principal for s in task.others)] == ["b", "a", "c"]
    assert [s.principal for s in task.simulated] == ["b", "a", "c"]
    for i, samples in enumerate(learned(task)):
        given_ = samples.estimates
        assert_allclose(task.truth_of(given_), benchmark.truth[given_.im_id])
        table = benchmark.outcomes if i < 3 else benchmark.simulated
        assert table is not None
        rows = table.filter(
            pl.col("estimator") == samples.principal, pl.col("gripper") == samples.gripper
        )
        by_image = dict(rows.select("im_id", "success").rows())
        assert [by_image[i] for i in given_.im_id.tolist()] == samples.own_success.tolist()
    assert_allclose(task.truth, benchmark.truth[task.annotated.im_id])


def test_what_cannot_be_asked(benchmark: Benchmark) -> None:
    with pytest.raises(UnknownNameError, match="unknown protocol 'unseen_scene'"):
        list(tasks(benchmark, "unseen_scene", "a", "p"))
    with pytest.raises(InputError, match="outcomes of your own simulated trials are needed"):
        without = dataclasses.replace(benchmark, simulated=None)
        list(tasks(without, "unseen_object_simulated", "a", "p"))
    one = benchmark.outcomes.filter(pl.col("gripper") == "p")
    with pytest.raises(InputError, match="there are outcomes of p"):
        list(tasks(dataclasses.replace(benchmark, outcomes=one), "unseen_gripper", "a", "p"))
    nothing = np.zeros(len(benchmark), dtype=bool)
    with pytest.raises(InputError, match="no grasp guided by a with the p gripper"):
        forecast(Majority(), "majority", benchmark, "unseen_scenes", "a", "p", rows=nothing)
    with pytest.raises(MismatchError, match=r"odd returned \(1,\) probabilities for"):
        forecast(lambda _: np.array([0.5]), "odd", benchmark, "unseen_scenes", "a", "p")
