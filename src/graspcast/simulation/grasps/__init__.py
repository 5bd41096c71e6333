"""TODO grasps."""
