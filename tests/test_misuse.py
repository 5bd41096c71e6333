"""Whatever is given to the public functions, the answer is a result or a GraspcastError."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import graspcast
import synthetic
from bricks import brick
from graspcast.bop.models import Models
from graspcast.errors import GraspcastError
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.guarantees.drift_monitor import DriftMonitor
from graspcast.simulation.grasps.pose_files import read_grasp_poses
from graspcast.simulation.grasps.table import write_grasps
from graspcast.simulation.objects.types import Grasp
from poses import results_of, write_models


class OnAnotherDevice:
    """A tensor that cannot be converted."""

    shape = (4, 4)

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise RuntimeError("can't convert device tensor to numpy")


ODD: list[Any] = [
    None, 0, -1, 3.5, float("nan"), True, 10**400, "text", "", b"x", [], [1], [[1, 2], [3]], {},
    {"a": 1}, {1: np.eye(4)}, (), set(), object(), print, np.eye(4), np.eye(3), np.zeros((0, 4, 4)),
    np.full((4, 4), np.nan), np.array(["a"]), np.array([None]), np.eye(4) * 1j, np.eye(4).tolist(),
    pl.DataFrame({"a": [1]}), OnAnotherDevice(), {"a": np.eye(4), "b": "x", "c": None},
]  # fmt: skip


TOP = Grasp(np.eye(4), "d-1", "parallel")


@dataclass
class World:
    models: dict[str, Models]
    data: Any
    forecaster: Any
    estimates: Any

    @property
    def poses(self) -> dict[str, np.ndarray]:
        return {name: self.estimates.of(name)[0] for name in "abc"}

    @property
    def results(self) -> dict[str, Any]:
        return {name: results_of(self.estimates.of(name)) for name in "abc"}

    @property
    def episode(self) -> Any:
        return graspcast.Episode(self.forecaster, "d-1", models=self.models)

    @property
    def frame(self) -> dict[str, Any]:
        ids = {"scene_id": [1], "im_id": [3], "obj_id": [5], "score": [0.9]}
        return {**ids, "cam_T_obj": [self.estimates.of("a")[0]]}


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    folder = write_models(tmp_path_factory.mktemp("m"), obj_1={}, obj_2={})
    models, data = {"d": Models(folder)}, synthetic.training_data(60)
    settings = ForestSettings(trees=4, folds=0)
    forecaster = graspcast.train_forecaster(data, models=models, forests=settings)
    return World(models, data, forecaster, synthetic.estimates(6))


Call = Callable[[World, Any], Any]
CALLS: dict[str, Call] = {
    "predict, poses": lambda w, x: w.forecaster.predict(x, "d-1", models=w.models),
    "predict, pose": lambda w, x: w.forecaster.predict({**w.poses, "b": x}, "d-1", models=w.models),
    "predict, object": lambda w, x: w.forecaster.predict(w.poses, x, models=w.models),
    "predict, threshold": lambda w, x: w.forecaster.predict(
        w.poses, "d-1", models=w.models, threshold=x
    ),
    "predict, ood_alpha": lambda w, x: w.forecaster.predict(
        w.poses, "d-1", models=w.models, ood_alpha=x
    ),
    "predict, models": lambda w, x: w.forecaster.predict(w.poses, "d-1", models=x),
    "predict, model": lambda w, x: w.forecaster.predict(w.poses, "d-1", models={"d": x}),
    "verdicts": lambda w, x: w.forecaster.verdicts(x, w.models),
    "verdicts, models": lambda w, x: w.forecaster.verdicts(w.estimates, x),
    "verdicts, threshold": lambda w, x: w.forecaster.verdicts(w.estimates, w.models, threshold=x),
    "verdicts, ood_alpha": lambda w, x: w.forecaster.verdicts(w.estimates, w.models, ood_alpha=x),
    "frame": lambda w, x: w.forecaster.predict_frame(x, "d", models=w.models),
    "frame, results": lambda w, x: w.forecaster.predict_frame(
        {**w.results, "b": x}, "d", models=w.models
    ),
    "frame, dataset": lambda w, x: w.forecaster.predict_frame(w.results, x, models=w.models),
    "probability": lambda w, x: w.forecaster.probability(x, w.models),
    "p_value": lambda w, x: w.forecaster.p_value(x),
    "explain": lambda w, x: w.forecaster.explain(x, w.models),
    "load": lambda w, x: graspcast.Forecaster.load(x),
    "align": lambda w, x: graspcast.align(x, dataset="d"),
    "align, results": lambda w, x: graspcast.align({**w.results, "b": x}, dataset="d"),
    "align, dataset": lambda w, x: graspcast.align(w.results, dataset=x),
    "align, anchor": lambda w, x: graspcast.align(w.results, dataset="d", anchor=x),
    "align, models": lambda w, x: graspcast.align(w.results, dataset="d", models=x),
    "from_frame": lambda w, x: graspcast.Results.from_frame(x),
    "from_frame, column": lambda w, x: [_tried(w.frame, name, x) for name in w.frame],
    "from_frame, cell": lambda w, x: [_tried(w.frame, name, [x]) for name in w.frame],
    "Results": lambda w, x: replace(w.results["a"], cam_T_obj=x),
    "Results, score": lambda w, x: replace(w.results["a"], score=x),
    "Results, obj_id": lambda w, x: replace(w.results["a"], obj_id=x),
    "Estimates": lambda w, x: replace(w.estimates, cam_T_obj=x),
    "Estimates, instances": lambda w, x: replace(w.estimates, instances=x),
    "InstanceKey": lambda w, x: str(graspcast.InstanceKey(x, 1, 2, x, 0)),
    "read_results": lambda w, x: graspcast.read_results(x),
    "read_outcomes": lambda w, x: graspcast.read_outcomes(x),
    "read_verdicts": lambda w, x: graspcast.read_verdicts(x),
    "read_detections": lambda w, x: graspcast.read_detections(x),
    "BopDataset": lambda w, x: graspcast.BopDataset(x),
    "load_inputs": lambda w, x: graspcast.load_inputs(x),
    "load_inputs, path": lambda w, x: graspcast.load_inputs({"a": x}),
    "load_inputs, bop": lambda w, x: graspcast.load_inputs({}, bop=x),
    "consensus_features": lambda w, x: graspcast.consensus_features(x, "a"),
    "consensus_features, principal": lambda w, x: graspcast.consensus_features(w.estimates, x),
    "Fallbacks": lambda w, x: graspcast.Fallbacks(x),
    "Fallbacks, poses": lambda w, x: graspcast.Fallbacks([w.forecaster]).predict(x, "d-1"),
    "Fallbacks, pose": lambda w, x: graspcast.Fallbacks([w.forecaster]).predict(
        {**w.poses, "b": x}, "d-1", models=w.models
    ),
    "certify": lambda w, x: graspcast.certify_forecaster(x, w.data),
    "certify, data": lambda w, x: graspcast.certify_forecaster(w.forecaster, x),
    "cross_validate": lambda w, x: graspcast.cross_validate(x),
    "train": lambda w, x: graspcast.train_forecaster(x),
    "score_verdicts": lambda w, x: graspcast.score_verdicts(x, pl.DataFrame()),
    "score_verdicts, outcomes": lambda w, x: graspcast.score_verdicts([], x),
    "score_verdicts, both": lambda w, x: graspcast.score_verdicts(
        w.forecaster.predict_frame(w.results, "d", models=w.models), x
    ),
    "Certificate": lambda w, x: graspcast.Certificate.load(x),
    "DriftMonitor": lambda w, x: graspcast.DriftMonitor(x),
    "DriftMonitor, file": lambda w, x: DriftMonitor.load(x),
    "built_in": lambda w, x: graspcast.built_in(x),
    "measure": lambda w, x: graspcast.measure(x, x),
    "true_poses": lambda w, x: graspcast.true_poses(x, "a", {}),
    "load_gripper": lambda w, x: graspcast.load_gripper(x),
    "read_grasps": lambda w, x: graspcast.read_grasps(x),
    "join, outcomes": lambda w, x: graspcast.TrainingData.join(w.estimates, x, "a", "parallel"),
    "monitor": lambda w, x: graspcast.DriftMonitor(0.9).observe(x),
    "monitor, unit": lambda w, x: graspcast.DriftMonitor(0.9).observe(True, unit=x),
    "monitor, alpha": lambda w, x: graspcast.DriftMonitor(0.9, alpha=x),
    "monitor, most": lambda w, x: graspcast.DriftMonitor(0.9, max_attempts_per_unit=x),
    "certify, rate": lambda w, x: graspcast.certify_forecaster(w.forecaster, w.data, rate=x),
    "compare": lambda w, x: graspcast.compare(x),
    "write_results": lambda w, x: graspcast.write_results("r.csv", x),
    "write_results, path": lambda w, x: graspcast.write_results(x, w.results["a"]),
    "write_verdicts": lambda w, x: graspcast.write_verdicts("v.csv", x),
    "save": lambda w, x: w.forecaster.save(x),
    "SimulatedTrials": lambda w, x: graspcast.SimulatedTrials.read(x, "parallel"),
    "load_object": lambda w, x: graspcast.load_object(x),
    "check_estimator": lambda w, x: graspcast.check_estimator(x, x, x),
    "check_gripper": lambda w, x: graspcast.check_gripper(x),
    "trials_from_estimates": lambda w, x: graspcast.trials_from_estimates(x, x, x),
    "trials_from_transferred_errors": lambda w, x: graspcast.trials_from_transferred_errors(
        x, x, count=x
    ),
    "trials_from_transferred_errors, count": lambda w, x: graspcast.trials_from_transferred_errors(
        graspcast.PoseErrors.of_deviations(0.002, 0.008, 0.07), [TOP], count=x
    ),
    "PoseErrors": lambda w, x: graspcast.PoseErrors.of_deviations(x, x, x),
    "PoseErrors, tails": lambda w, x: graspcast.PoseErrors.of_deviations(0.1, 0.1, 0.1, tails=x),
    "guiding_errors": lambda w, x: graspcast.guiding_errors(x),
    "guiding_errors, count": lambda w, x: graspcast.guiding_errors(brick(), count=x),
    "propose_grasps": lambda w, x: graspcast.propose_grasps(x, x, x),
    "propose_grasps, gripper": lambda w, x: graspcast.propose_grasps(brick(), x, x),
    "propose_grasps, known": lambda w, x: graspcast.propose_grasps(
        brick(), graspcast.load_gripper("parallel"), np.eye(4)[None], known=x, count=0
    ),
    "measure_tolerance": lambda w, x: graspcast.measure_tolerance(x, x),
    "Grasp": lambda w, x: Grasp(x, "a", "b"),
    "Grasp, name": lambda w, x: Grasp(np.eye(4), "a", "b", x),
    "write_grasps": lambda w, x: write_grasps("g.toml", x),
    "read_grasp_poses": lambda w, x: read_grasp_poses(x),
    "run_campaign": lambda w, x: graspcast.run_campaign(x, x, x),
    "Look": lambda w, x: graspcast.fuse_looks([graspcast.Look(x, np.eye(4))]),
    "fuse_looks": lambda w, x: graspcast.fuse_looks(x),
    "Episode": lambda w, x: graspcast.Episode(w.forecaster, x, models=w.models),
    "Episode, poses": lambda w, x: w.episode.look(x, np.eye(4)),
    "Episode, pose": lambda w, x: w.episode.look({**w.poses, "b": x}, np.eye(4)),
    "Episode, camera": lambda w, x: w.episode.look(w.poses, x),
    "load_setups": lambda w, x: graspcast.load_setups(x, x),
    "reproduce": lambda w, x: graspcast.reproduce(x),
    "join": lambda w, x: graspcast.TrainingData.join(x, None, "a", "parallel"),
}


def _tried(frame: dict[str, Any], name: str, value: Any) -> None:
    with suppress(GraspcastError):
        graspcast.Results.from_frame({**frame, name: value})


@pytest.mark.ill_typed
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", CALLS)
def test_the_answer_is_a_result_or_a_graspcast_error(
    name: str, world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for odd in ODD:
        try:
            CALLS[name](world, odd)
        except GraspcastError as error:
            assert len(str(error)) > 10


@pytest.mark.ill_typed
def test_lists_of_numbers_that_are_fine_are_accepted(world: World) -> None:
    given = {name: pose.tolist() for name, pose in world.poses.items()}
    verdict = world.forecaster.predict(given, "d-1", models=world.models)
    same = world.forecaster.predict(world.poses, "d-1", models=world.models)
    assert verdict.probability == same.probability
    assert verdict.probability is not None
