"""TODO estimates."""
