"""Metrics of the service, as Prometheus reads them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.process_collector import ProcessCollector

__all__ = ["METRICS_TYPE", "Metrics"]

METRICS_TYPE = "text/plain; version=0.0.4; charset=utf-8"
_SECONDS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_SIZES = (1, 2, 4, 8, 16, 32, 64, 128)
_ACTIONS = ("attempt", "look again", "abstain")


class Metrics:
    """Counts and times of a service, in a registry of their own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        self._requests = self._counter(
            "requests", "Requests that were answered.", ("method", "route", "status")
        )
        self._seconds = Histogram(
            "graspcast_request_seconds",
            "Time from a request's headers to its answer.",
            ("route",),
            buckets=_SECONDS,
            registry=self.registry,
        )
        decisions = self._counter("decisions", "Decisions by action.", ("action",))
        self._decisions = {action: decisions.labels(action) for action in _ACTIONS}
        outcomes = self._counter("outcomes", "Outcomes that were recorded.", ("success",))
        self._outcomes = {value: outcomes.labels(str(value).lower()) for value in (True, False)}
        self._batches = Histogram(
            "graspcast_batch_frames",
            "Frames that were judged at once.",
            buckets=_SIZES,
            registry=self.registry,
        )
        # Labels are looked up for every request, which their own look-up is too slow for.
        self._known: dict[tuple[str, str, int], tuple[Counter, Histogram]] = {}

    def _counter(self, name: str, what: str, labels: tuple[str, ...]) -> Counter:
        return Counter(f"graspcast_{name}", what, labels, registry=self.registry)

    def gauge(self, name: str, what: str, value: Callable[[], float]) -> None:
        """Add a gauge that is read when metrics are asked for."""
        Gauge(f"graspcast_{name}", what, registry=self.registry).set_function(value)

    def request(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count an answered request."""
        key = method, route, status
        if (found := self._known.get(key)) is None:
            found = self._requests.labels(method, route, str(status)), self._seconds.labels(route)
            self._known[key] = found
        found[0].inc()
        found[1].observe(seconds)

    def decided(self, actions: Iterable[str]) -> None:
        """Count decisions."""
        for action in actions:
            self._decisions[action].inc()

    def judged(self, frames: int) -> None:
        """Count a batch of frames."""
        self._batches.observe(frames)

    def recorded(self, success: bool) -> None:
        """Count an outcome."""
        self._outcomes[success].inc()

    def text(self) -> bytes:
        """Return all metrics as text."""
        return generate_latest(self.registry)
