"""Session of the node: models, log and judging by its parameters, and what it says of itself."""

from __future__ import annotations

__all__: list[str] = []
