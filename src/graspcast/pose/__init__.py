"""TODO pose."""
