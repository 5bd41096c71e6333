"""TODO trials."""
