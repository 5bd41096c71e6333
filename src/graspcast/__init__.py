"""Forecasts of grasp success from the pose estimates of several RGB pose estimators.

One estimator, the principal, would guide the grasp. From how the others, its supporters, disagree
with it, graspcast forecasts the probability of success, and decides: attempt the grasp, or abstain.

A complete example, from files to verdicts and their score::

    from graspcast import (
        Forecaster, TrainingData, load_inputs, read_outcomes, score_verdicts, train_forecaster
    )

    names = ("epos", "gdrnpp", "zebrapose")
    inputs = load_inputs({n: f"{n}_lmo-test.csv" for n in names}, bop=["lmo"])
    estimates = inputs.estimates("gdrnpp")  # the principal's instances, with the others' poses
    outcomes = read_outcomes("trials.csv")
    data = TrainingData.join(
        estimates, outcomes, "gdrnpp", "parallel", truth=inputs.truth(estimates, "gdrnpp")
    )
    forecaster = train_forecaster(data, models=inputs.models)
    forecaster.save("model.npz")

    frame = load_inputs({n: f"today/{n}_lmo-test.csv" for n in names}, bop=["lmo"])
    rows = forecaster.predict_frame(frame.results["lmo"], "lmo", models=frame.models, threshold=0.8)
    for row in rows:
        print(row.key, row.verdict, row.verdict.reason)
    print(score_verdicts(rows, read_outcomes("today.csv")))

Lengths are metres, transforms 4x4 and named ``a_T_b`` (points of frame b into frame a), the camera
frame is OpenCV's. Every name below is loaded when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from graspcast._version import __version__

if TYPE_CHECKING:
    from graspcast.attempt_log.log import AttemptLog
    from graspcast.bop.dataset import BopDataset
    from graspcast.bop.detections import read_detections
    from graspcast.bop.pose_rows import Stated
    from graspcast.bop.results import Results, read_results, write_results
    from graspcast.demo_data import demo_dataset, demo_model
    from graspcast.diagnosis.diagnose import diagnose
    from graspcast.diagnosis.finding import Finding
    from graspcast.errors import GraspcastError
    from graspcast.estimates.alignment import Estimates, align
    from graspcast.estimates.conversion import convert_poses
    from graspcast.estimates.error_tables import measure
    from graspcast.estimates.instances import InstanceKey
    from graspcast.estimates.loading import load_inputs
    from graspcast.estimates.matching import true_poses
    from graspcast.estimates.outcomes import read_outcomes
    from graspcast.evaluation.certification import GuaranteeOptions, certify_forecaster
    from graspcast.evaluation.cross_validation import cross_validate
    from graspcast.evaluation.estimator_comparison import compare
    from graspcast.evaluation.policy_certification import certify_policy
    from graspcast.evaluation.verdict_scores import score_verdicts
    from graspcast.forecasting.episode import Episode
    from graspcast.forecasting.episode_verdict import EpisodeVerdict
    from graspcast.forecasting.episodes import Episodes
    from graspcast.forecasting.fallbacks import Fallbacks
    from graspcast.forecasting.features import consensus_features
    from graspcast.forecasting.forecaster import Forecaster
    from graspcast.forecasting.grasp_ranking import GraspForecast
    from graspcast.forecasting.models.blend import ForestSettings
    from graspcast.forecasting.recorded_verdicts import ViewSettings
    from graspcast.forecasting.simulated_trials import SimulatedTrials
    from graspcast.forecasting.train import train_forecaster
    from graspcast.forecasting.training_data import TrainingData
    from graspcast.forecasting.verdict import Verdict, VerdictRow
    from graspcast.forecasting.verdict_file import read_verdicts, write_verdicts
    from graspcast.guarantees.certificate import Certificate
    from graspcast.guarantees.drift_monitor import DriftMonitor
    from graspcast.paper.tables import reproduce
    from graspcast.perception.conformance import check_estimator
    from graspcast.perception.estimator import Estimator, built_in
    from graspcast.runtime.answer import Answer, Decision
    from graspcast.runtime.frame import Estimate, Frame
    from graspcast.runtime.watcher import Watcher
    from graspcast.simulation.campaign.campaign import run_campaign
    from graspcast.simulation.campaign.from_estimates import trials_from_estimates
    from graspcast.simulation.campaign.jobs import load_setups
    from graspcast.simulation.campaign.pose_errors import PoseErrors
    from graspcast.simulation.campaign.transferred_errors import trials_from_transferred_errors
    from graspcast.simulation.grasps.guiding_errors import guiding_errors
    from graspcast.simulation.grasps.proposing import propose_grasps
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.grasps.tolerance import measure_tolerance
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.objects.load import load_object
    from graspcast.simulation.trial.gripper_conformance import check_gripper
    from graspcast.simulation.trial.settings import TrialSettings
    from graspcast.simulation.trial.trial import TrialRunner
    from graspcast.views.camera_motion import CameraMotion, CameraNoise
    from graspcast.views.camera_tables import read_camera_motion
    from graspcast.views.fused_estimates import FusedEstimates, fuse_estimates
    from graspcast.views.look import Look
    from graspcast.views.looks import fuse_looks
    from graspcast.views.next_look import NextLook, next_look
    from graspcast.views.object_motion import ObjectMotion
    from graspcast.views.spread import learn_spreads

_HOME = {
    "attempt_log.log": ("AttemptLog",),
    "bop.dataset": ("BopDataset",),
    "bop.detections": ("read_detections",),
    "bop.pose_rows": ("Stated",),
    "bop.results": (
        "Results",
        "read_results",
        "write_results",
    ),
    "demo_data": ("demo_dataset", "demo_model"),
    "diagnosis.diagnose": ("diagnose",),
    "diagnosis.finding": ("Finding",),
    "errors": ("GraspcastError",),
    "estimates.alignment": (
        "Estimates",
        "align",
    ),
    "estimates.conversion": ("convert_poses",),
    "estimates.error_tables": ("measure",),
    "estimates.instances": ("InstanceKey",),
    "estimates.loading": ("load_inputs",),
    "estimates.matching": ("true_poses",),
    "estimates.outcomes": ("read_outcomes",),
    "evaluation.certification": ("GuaranteeOptions", "certify_forecaster"),
    "evaluation.cross_validation": ("cross_validate",),
    "evaluation.estimator_comparison": ("compare",),
    "evaluation.policy_certification": ("certify_policy",),
    "evaluation.verdict_scores": ("score_verdicts",),
    "forecasting.episode_verdict": ("EpisodeVerdict",),
    "forecasting.episode": ("Episode",),
    "forecasting.episodes": ("Episodes",),
    "forecasting.fallbacks": ("Fallbacks",),
    "forecasting.features": ("consensus_features",),
    "forecasting.forecaster": ("Forecaster",),
    "forecasting.grasp_ranking": ("GraspForecast",),
    "forecasting.models.blend": ("ForestSettings",),
    "forecasting.recorded_verdicts": ("ViewSettings",),
    "forecasting.train": ("train_forecaster",),
    "forecasting.simulated_trials": ("SimulatedTrials",),
    "forecasting.training_data": ("TrainingData",),
    "forecasting.verdict": ("Verdict", "VerdictRow"),
    "forecasting.verdict_file": ("read_verdicts", "write_verdicts"),
    "guarantees.certificate": ("Certificate",),
    "guarantees.drift_monitor": ("DriftMonitor",),
    "paper.tables": ("reproduce",),
    "perception.conformance": ("check_estimator",),
    "perception.estimator": (
        "Estimator",
        "built_in",
    ),
    "runtime.answer": ("Answer", "Decision"),
    "runtime.frame": ("Estimate", "Frame"),
    "runtime.watcher": ("Watcher",),
    "simulation.campaign.campaign": ("run_campaign",),
    "simulation.campaign.from_estimates": ("trials_from_estimates",),
    "simulation.campaign.jobs": ("load_setups",),
    "simulation.campaign.pose_errors": ("PoseErrors",),
    "simulation.campaign.transferred_errors": ("trials_from_transferred_errors",),
    "simulation.grasps.table": ("read_grasps",),
    "simulation.grasps.guiding_errors": ("guiding_errors",),
    "simulation.grasps.proposing": ("propose_grasps",),
    "simulation.grasps.tolerance": ("measure_tolerance",),
    "simulation.grippers": ("load_gripper",),
    "simulation.objects.load": ("load_object",),
    "simulation.trial.gripper_conformance": ("check_gripper",),
    "simulation.trial.settings": ("TrialSettings",),
    "simulation.trial.trial": ("TrialRunner",),
    "views.camera_motion": ("CameraMotion", "CameraNoise"),
    "views.camera_tables": ("read_camera_motion",),
    "views.fused_estimates": ("FusedEstimates", "fuse_estimates"),
    "views.look": ("Look",),
    "views.looks": ("fuse_looks",),
    "views.next_look": ("NextLook", "next_look"),
    "views.object_motion": ("ObjectMotion",),
    "views.spread": ("learn_spreads",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [*_MODULE_OF, "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'graspcast' has no attribute {name!r}")
    value = getattr(import_module(f"graspcast.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
