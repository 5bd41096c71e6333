"""Grasp trials in simulation: objects, grippers, reference grasps, trials and their outcomes."""
