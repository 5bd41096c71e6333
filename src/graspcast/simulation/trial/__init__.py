"""Grasp trials in simulation: settings, scene, phases, outcome, recording."""
