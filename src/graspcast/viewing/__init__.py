"""Scenes to turn: estimates, grasps and trials in three dimensions, and as glTF files."""
