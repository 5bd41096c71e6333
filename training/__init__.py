"""How the weights that ship with graspcast were made: ``python -m training --help``."""
