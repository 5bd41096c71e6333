"""Pictures, films and an interactive viewer of grasp trials."""
