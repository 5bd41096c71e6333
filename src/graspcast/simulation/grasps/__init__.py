"""Reference grasps, and the search for grasps that agree with observed outcomes."""
