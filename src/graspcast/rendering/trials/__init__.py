"""Pictures and films of grasp trials."""
