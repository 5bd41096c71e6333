"""Learning from outcomes: samples, the baseline, the networks, the forecaster and their scores."""
