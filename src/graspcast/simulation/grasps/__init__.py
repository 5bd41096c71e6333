"""Reference grasps, and the search for them."""
