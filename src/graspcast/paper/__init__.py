"""The tables of Joyce et al. (IROS 2025), the authors' release, and their configurations."""
