"""TODO guarantees."""
