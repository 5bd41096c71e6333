"""Models of grasp success: what a forecaster holds."""
