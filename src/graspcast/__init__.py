"""Forecasts of grasp success from the pose estimates of several RGB pose estimators.

Several RGB pose estimators look at the same object. One, the principal, would guide the grasp; from
how the others disagree with it graspcast forecasts the grasp's success, and says whether to attempt
it. Everything public is named here, and loaded when it is first asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from graspcast._version import __version__

if TYPE_CHECKING:
    from graspcast.bop.dataset import BopDataset, GroundTruth
    from graspcast.bop.detections import Detections, read_detections
    from graspcast.bop.models import Models
    from graspcast.bop.results import Results, read_results, write_results
    from graspcast.demo_data import demo_dataset
    from graspcast.errors import GraspcastError
    from graspcast.estimates.alignment import Estimates, align, concatenate
    from graspcast.estimates.error_tables import measure, summarise
    from graspcast.estimates.instances import unit_names
    from graspcast.estimates.matching import match
    from graspcast.estimates.outcomes import read_outcomes
    from graspcast.evaluation.certification import certify_forecaster
    from graspcast.evaluation.cross_validation import cross_validate
    from graspcast.evaluation.estimator_comparison import Comparison, compare
    from graspcast.evaluation.scores import Scores, score
    from graspcast.evaluation.verdict_scores import VerdictScores, score_verdicts
    from graspcast.forecasting.features import Features, consensus_features, describe, mean_add
    from graspcast.forecasting.forecaster import Forecaster
    from graspcast.forecasting.models.blend import ForestSettings
    from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
    from graspcast.forecasting.train import train_forecaster
    from graspcast.forecasting.training_data import SimulatedTrials, TrainingData
    from graspcast.forecasting.verdict import (
        Verdict,
        decide,
        read_verdicts,
        verdict_rows,
        write_verdicts,
    )
    from graspcast.guarantees.certificate import Certificate, Guarantee
    from graspcast.guarantees.certify import certify
    from graspcast.guarantees.drift_monitor import DriftMonitor
    from graspcast.guarantees.threshold_sequence import ThresholdSequence, learn_sequence
    from graspcast.paper.dataset import Published
    from graspcast.paper.release import import_release
    from graspcast.paper.tables import reproduce
    from graspcast.perception.conformance import check_estimator
    from graspcast.perception.estimator import Estimator, built_in
    from graspcast.rendering.synthetic.dataset import render_dataset
    from graspcast.simulation.campaign.campaign import run_campaign
    from graspcast.simulation.campaign.from_estimates import trials_from_estimates
    from graspcast.simulation.campaign.jobs import load_setups
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.objects.load import load_object
    from graspcast.simulation.objects.types import Grasp, GraspObject
    from graspcast.simulation.trial.gripper_conformance import check_gripper
    from graspcast.simulation.trial.trial import Outcome, TrialRunner

_HOME = {
    "bop.dataset": (
        "BopDataset",
        "GroundTruth",
    ),
    "bop.detections": (
        "Detections",
        "read_detections",
    ),
    "bop.models": ("Models",),
    "bop.results": (
        "Results",
        "read_results",
        "write_results",
    ),
    "demo_data": ("demo_dataset",),
    "errors": ("GraspcastError",),
    "estimates.alignment": (
        "Estimates",
        "align",
        "concatenate",
    ),
    "estimates.error_tables": (
        "measure",
        "summarise",
    ),
    "estimates.instances": ("unit_names",),
    "estimates.matching": ("match",),
    "estimates.outcomes": ("read_outcomes",),
    "evaluation.certification": ("certify_forecaster",),
    "evaluation.cross_validation": ("cross_validate",),
    "evaluation.estimator_comparison": (
        "Comparison",
        "compare",
    ),
    "evaluation.scores": (
        "Scores",
        "score",
    ),
    "evaluation.verdict_scores": (
        "VerdictScores",
        "score_verdicts",
    ),
    "forecasting.features": (
        "Features",
        "consensus_features",
        "describe",
        "mean_add",
    ),
    "forecasting.forecaster": ("Forecaster",),
    "forecasting.models.blend": ("ForestSettings",),
    "forecasting.models.mlp.ensemble": ("NetworkSettings",),
    "forecasting.train": ("train_forecaster",),
    "forecasting.training_data": (
        "SimulatedTrials",
        "TrainingData",
    ),
    "forecasting.verdict": (
        "Verdict",
        "decide",
        "read_verdicts",
        "verdict_rows",
        "write_verdicts",
    ),
    "guarantees.certificate": (
        "Guarantee",
        "Certificate",
    ),
    "guarantees.certify": ("certify",),
    "guarantees.drift_monitor": ("DriftMonitor",),
    "guarantees.threshold_sequence": (
        "ThresholdSequence",
        "learn_sequence",
    ),
    "paper.dataset": ("Published",),
    "paper.release": ("import_release",),
    "paper.tables": ("reproduce",),
    "perception.conformance": ("check_estimator",),
    "perception.estimator": (
        "Estimator",
        "built_in",
    ),
    "rendering.synthetic.dataset": ("render_dataset",),
    "simulation.campaign.campaign": ("run_campaign",),
    "simulation.campaign.from_estimates": ("trials_from_estimates",),
    "simulation.campaign.jobs": ("load_setups",),
    "simulation.grasps.table": ("read_grasps",),
    "simulation.grippers": ("load_gripper",),
    "simulation.objects.load": ("load_object",),
    "simulation.objects.types": (
        "Grasp",
        "GraspObject",
    ),
    "simulation.trial.gripper_conformance": ("check_gripper",),
    "simulation.trial.trial": (
        "Outcome",
        "TrialRunner",
    ),
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
