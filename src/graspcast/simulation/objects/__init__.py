"""Objects of trials: catalogue, meshes, collision shapes, rest poses."""
