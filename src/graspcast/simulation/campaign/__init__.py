"""Many trials: requests, jobs, workers, the resumable store of outcomes."""
