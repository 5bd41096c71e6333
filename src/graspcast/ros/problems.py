"""Problems of a stream: what was left out and why, counted, each kind with its first case."""

from __future__ import annotations

from collections import Counter

__all__ = ["Problems"]


class Problems:
    """Counts of what was wrong, by kind.

    ::

        problems = Problems()
        problems.add("estimate of an unknown class", "'box' (topic /epos)")
        print(*problems.lines())
    """

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._first: dict[str, str] = {}

    def __bool__(self) -> bool:
        return bool(self._counts)

    def add(self, kind: str, case: str = "") -> None:
        """Count one more of a kind; the first case is kept as the example."""
        self._counts[kind] += 1
        self._first.setdefault(kind, case)

    def update(self, other: Problems) -> None:
        """Add the counts of others."""
        for kind, number in other._counts.items():
            self._counts[kind] += number
            self._first.setdefault(kind, other._first[kind])

    def counts(self) -> dict[str, int]:
        """Return how many there were of each kind."""
        return dict(self._counts)

    def lines(self) -> list[str]:
        """Return one line for each kind: what, how often, and the first case."""
        out = []
        for kind, number in self._counts.items():
            first = self._first[kind]
            out.append(f"{kind}: {number}" + (f" (first: {first})" if first else ""))
        return out
