"""From pose estimates to the probability of grasp success, and to a verdict."""
