"""Evaluation of forecasts: scores with confidence intervals, comparisons, certification."""
