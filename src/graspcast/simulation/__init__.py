"""Grasp trials in MuJoCo."""
