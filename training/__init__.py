"""Training of the built-in estimators: ``python -m training --help``."""
