"""From an image to poses: the protocol of an estimator, and three small ones of our own."""

from __future__ import annotations

from graspcast.perception.estimator import BUILT_IN, Estimator, Poses, built_in

__all__ = ["BUILT_IN", "Estimator", "Poses", "built_in"]
