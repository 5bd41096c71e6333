"""Pose estimates: instances and their keys, alignment of estimators, matching with ground truth, outcomes."""
