from __future__ import annotations

from graspcast.service.metrics import Metrics


def test_counts_are_shown() -> None:
    metrics = Metrics()
    metrics.decided(["attempt", "abstain", "attempt"])
    metrics.recorded(False)
    metrics.judged(3)
    for _ in range(2):
        metrics.request("POST", "/frames", 200, 0.003)
    metrics.gauge("waiting", "Requests that wait.", lambda: 7)
    lines = metrics.text().decode().splitlines()
    for line in (
        'graspcast_decisions_total{action="attempt"} 2.0',
        'graspcast_decisions_total{action="abstain"} 1.0',
        'graspcast_decisions_total{action="look again"} 0.0',
        'graspcast_outcomes_total{success="false"} 1.0',
        'graspcast_batch_frames_bucket{le="4.0"} 1.0',
        'graspcast_requests_total{method="POST",route="/frames",status="200"} 2.0',
        'graspcast_request_seconds_bucket{le="0.005",route="/frames"} 2.0',
        "graspcast_waiting 7.0",
    ):
        assert line in lines, line


def test_two_services_in_a_process_count_apart() -> None:
    first, second = Metrics(), Metrics()
    first.recorded(True)
    assert 'graspcast_outcomes_total{success="true"} 0.0' in second.text().decode()
