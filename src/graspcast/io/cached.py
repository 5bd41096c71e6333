"""Cached properties that hold no lock.

Until Python 3.12, ``functools.cached_property`` holds one lock for all instances of a class while
it computes. Threads then wait for each other, and a process that is forked meanwhile may wait
forever.
Here two threads may compute a value twice; both get the first.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

__all__ = ["cached_property"]

if TYPE_CHECKING:
    from functools import cached_property
else:

    class cached_property(functools.cached_property):  # noqa: N801
        """A property that is computed once, when it is first asked for."""

        def __get__(self, instance: Any, owner: type | None = None) -> Any:
            """Return the value, computed if it is not there."""
            if instance is None:
                return self
            values = instance.__dict__
            if self.attrname not in values:
                values.setdefault(self.attrname, self.func(instance))
            return values[self.attrname]
