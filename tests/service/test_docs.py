"""docs/service.md says what is so."""

from __future__ import annotations

import json
import re
from pathlib import Path

from graspcast.service.limits import Limits
from graspcast.service.schemas import FrameIn
from service_client import asked
from stub_watcher import StubWatcher

PAGE = (Path(__file__).parents[2] / "docs" / "service.md").read_text()


def test_the_request_by_curl_fits() -> None:
    found = re.search(r"-d '(\{.*?\})'", PAGE, re.DOTALL)
    assert found is not None
    FrameIn.model_validate(json.loads(found[1]))


def test_every_route_and_metric_is_there() -> None:
    document, metrics = asked(StubWatcher(), ("GET", "/openapi.json", {}), ("GET", "/metrics", {}))
    for path, operations in document.json()["paths"].items():
        for method in operations:
            assert f"`{method.upper()} {path}`" in PAGE
    for name in re.findall(r"^# TYPE (graspcast_\w+) ", metrics.text, re.MULTILINE):
        assert name.endswith("_created") or f"`{name}" in PAGE, name


def test_limits_are_those_of_the_service() -> None:
    limits = Limits()
    for line in (
        f"| body | {limits.body_bytes:,} bytes, {limits.body_s:g} s |",
        f"| line and headers | {limits.head_bytes:,} bytes, {limits.head_s:g} s |",
        f"| idle connection | {limits.idle_s:g} s |",
        f"| connections | {limits.connections} |",
        f"| waiting requests | {limits.waiting} |",
        f"| frames judged at once | {limits.batch} |",
        f"| a stop waits for accepted requests | {limits.stop_s:g} s |",
    ):
        assert line in PAGE
