"""Pose estimation from RGB: the estimator interface, built-in and external estimators."""

from __future__ import annotations

from graspcast.perception.estimator import BUILT_IN, Estimator, Poses, built_in

__all__ = ["BUILT_IN", "Estimator", "Poses", "built_in"]
