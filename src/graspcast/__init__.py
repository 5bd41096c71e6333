"""How likely is the grasp that a pose estimate would guide to succeed?

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
    from graspcast.evaluation.cross_validation import cross_validate
    from graspcast.evaluation.estimator_comparison import Comparison, compare
    from graspcast.evaluation.scores import Scores, score
    from graspcast.evaluation.verdict_scores import Scorecard, score_verdicts
    from graspcast.forecasting.features import Features, consensus_features, describe, mean_add
    from graspcast.forecasting.forecaster import Forecaster
    from graspcast.forecasting.models.blend import ForestSettings
    from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
    from graspcast.forecasting.samples import Samples, join
    from graspcast.forecasting.train import train_forecaster
    from graspcast.forecasting.training_data import ErrorOutcomes, Lessons, lessons
    from graspcast.forecasting.verdict import (
        Verdict,
        decide,
        read_verdicts,
        verdict_rows,
        write_verdicts,
    )
    from graspcast.guarantees.certificate import Promise, Promises
    from graspcast.guarantees.certify import certify
    from graspcast.guarantees.drift_monitor import DriftMonitor
    from graspcast.guarantees.threshold_sequence import Sequence, learn_sequence
    from graspcast.paper.dataset import Published
    from graspcast.paper.release import import_release
    from graspcast.paper.tables import reproduce
    from graspcast.perception.conformance import check_estimator
    from graspcast.perception.estimator import Estimator, built_in
    from graspcast.rendering.synthetic.dataset import render_dataset
    from graspcast.simulation.campaign.campaign import run_campaign
    from graspcast.simulation.campaign.from_estimates import guided_trials
    from graspcast.simulation.campaign.jobs import load_pairs
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.objects.load import load_object
    from graspcast.simulation.objects.types import Grasp, GraspObject
    from graspcast.simulation.trial.gripper_conformance import check_gripper
    from graspcast.simulation.trial.trial import Outcome, TrialRunner

_HOME = {
    "bop.dataset": ("BopDataset", "GroundTruth"),
    "bop.detections": ("Detections", "read_detections"),
    "bop.models": ("Models",),
    "bop.release": ("import_release",),
    "bop.results": ("Results", "read_results", "write_results"),
    "certification": ("certify", "unit_names"),
    "comparison": ("Comparison", "compare"),
    "consensus": ("Features", "consensus_features", "describe", "mean_add"),
    "demo_data": ("demo_dataset",),
    "drift": ("DriftMonitor",),
    "errors": ("GraspcastError",),
    "estimates": ("Estimates", "align", "concatenate"),
    "grasping.campaign": ("run_campaign",),
    "grasping.conformance": ("check_gripper",),
    "grasping.grasps": ("read_grasps",),
    "grasping.grippers": ("load_gripper",),
    "grasping.guided": ("guided_trials",),
    "grasping.objects": ("load_object",),
    "grasping.trial": ("Outcome", "TrialRunner"),
    "grasping.types": ("Grasp", "GraspObject"),
    "grasping.work": ("load_pairs",),
    "learning.blend": ("ForestSettings",),
    "learning.forecaster": ("Forecaster",),
    "learning.lessons": ("ErrorOutcomes", "Lessons", "lessons"),
    "learning.training": ("cross_validate", "train_forecaster"),
    "learning.predictors": ("NetworkSettings",),
    "learning.samples": ("Samples", "join"),
    "learning.scores": ("Scores", "score"),
    "outcomes": ("read_outcomes",),
    "perception.conformance": ("check_estimator",),
    "perception.estimator": ("Estimator", "built_in"),
    "promise": ("Promise", "Promises"),
    "published": ("Published",),
    "rendering.dataset": ("render_dataset",),
    "report.paper": ("reproduce",),
    "scorecard": ("Scorecard", "score_verdicts"),
    "thresholds": ("Sequence", "learn_sequence"),
    "truth": ("match", "measure", "summarise"),
    "verdict": ("Verdict", "decide", "read_verdicts", "verdict_rows", "write_verdicts"),
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
