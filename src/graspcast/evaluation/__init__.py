"""Evaluation of forecasts: scores with confidence intervals, protocols, comparisons, certification."""
