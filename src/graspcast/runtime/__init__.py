"""At the robot: verdicts on all estimates of a frame, from a model file alone."""
