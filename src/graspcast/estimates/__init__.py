"""Pose estimates: instance keys, alignment, matching with ground truth, outcomes."""
