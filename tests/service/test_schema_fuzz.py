"""Requests made up from the service's own documentation: none may be answered with a fault.

Cases are made as tests are collected, so without the slow tests this file is not collected.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, settings

from service_client import Process, asked, running, stub
from stub_watcher import StubWatcher

TOKEN = "correct-horse-battery"
SHOWN = {"Authorization": f"Bearer {TOKEN}"}
(DOCUMENT,) = asked(StubWatcher(), ("GET", "/openapi.json", {"headers": SHOWN}), token=TOKEN)
schema = schemathesis.openapi.from_dict(DOCUMENT.json())
# What fits the schema may still name objects that no model knows.
EXCLUDED = [schemathesis.checks.positive_data_acceptance]
given = settings(
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Process]:
    with running(stub(), tmp_path_factory.mktemp("fuzz"), GRASPCAST_TOKEN=TOKEN) as process:
        yield process


@pytest.mark.slow
@schema.parametrize()
@settings(given, max_examples=200)
def test_what_is_made_up_is_answered_as_documented(case: Any, service: Process) -> None:
    case.call_and_validate(base_url=service.url, headers=SHOWN, excluded_checks=EXCLUDED)
