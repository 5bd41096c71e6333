"""Objects to be grasped: catalogue, meshes, convex decomposition, mass and rest pose."""
