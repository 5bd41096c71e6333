"""TODO mlp."""
