from __future__ import annotations

import json
import sqlite3
from typing import Any

import pytest

from graspcast.errors import InputError
from graspcast.guarantees.log_monitor import MonitorStatus
from graspcast.service.answers import AnswerOut, HealthOut, MonitorOut, ProblemOut, RecordedOut
from graspcast.service.app import create_app
from graspcast.service.limits import Limits
from service_client import asked
from stub_watcher import StubWatcher, frame

OUTCOME = {"decision_id": "1-0", "success": True}


def post(path: str, content: Any, **given: Any) -> tuple[str, str, dict[str, Any]]:
    return "POST", path, {"json": content, **given}


def get(path: str, **given: Any) -> tuple[str, str, dict[str, Any]]:
    return "GET", path, given


def test_a_frame_is_answered_with_decisions() -> None:
    (response,) = asked(StubWatcher(), post("/frames", frame()))
    assert (response.status_code, response.headers["content-type"]) == (200, "application/json")
    answer = AnswerOut.model_validate_json(response.content, strict=True)
    (decision,) = answer.decisions
    assert (decision.object, decision.action, decision.id) == ("ycbv-5", "attempt", "1-0")
    assert decision.cam_T_obj is not None
    assert decision.cam_T_obj.translation_m == [0.1, -0.2, 0.7]
    assert decision.cam_T_obj.quaternion_wxyz == [1, 0, 0, 0]


def test_frames_that_come_together_are_judged_together() -> None:
    watcher = StubWatcher(seconds=0.05)
    responses = asked(watcher, *[post("/frames", frame())] * 20)
    assert {r.status_code for r in responses} == {200}
    assert len({r.json()["episode"] for r in responses}) == 20
    assert max(watcher.batches) > 5


def test_a_bad_frame_among_good_ones_is_refused_alone() -> None:
    watcher = StubWatcher(seconds=0.02)
    names = ["good-1", "bad-1", "good-1", "bug-1", "good-1"]
    responses = asked(watcher, *[post("/frames", frame(name)) for name in names])
    assert [r.status_code for r in responses] == [200, 422, 200, 500, 200]
    for response in (responses[1], responses[3]):
        assert response.headers["content-type"] == "application/problem+json"
        ProblemOut.model_validate_json(response.content)
    assert responses[1].json()["detail"] == "bad"
    assert "a fault of the service" in responses[3].json()["detail"]


def test_millimetres_are_read_as_such() -> None:
    seen: list[Any] = []

    class Watching(StubWatcher):
        def judge_all(self, frames: Any) -> list[Any]:
            seen.extend(frames)
            return super().judge_all(frames)

    given = frame(length_unit="mm", world_T_cam=frame()["estimates"]["dense"][0]["cam_T_obj"])
    asked(Watching(), post("/frames", given))
    (found,) = seen
    assert found.estimates["dense"][0].cam_T_obj[2, 3] == pytest.approx(0.0007)
    assert found.estimates["dense"][0].cam_T_obj[0, 0] == 1
    assert found.world_T_cam[2, 3] == pytest.approx(0.0007)


def test_an_outcome_is_recorded() -> None:
    watcher = StubWatcher()
    (response,) = asked(watcher, post("/outcomes", OUTCOME))
    assert RecordedOut.model_validate_json(response.content).recorded
    assert watcher.outcomes == {"1-0": True}


def test_health_and_metrics() -> None:
    watcher = StubWatcher()
    health, ready, _, _, metrics, head = asked(
        watcher, get("/health"), get("/health/ready"), post("/frames", frame()),
        post("/outcomes", OUTCOME), get("/metrics"), ("HEAD", "/health", {}),
    )  # fmt: skip
    assert HealthOut.model_validate_json(health.content).live
    assert ready.status_code in (200, 503)
    assert metrics.headers["content-type"].startswith("text/plain")
    assert "graspcast_ready 1.0" in metrics.text or "graspcast_ready 0.0" in metrics.text
    assert head.status_code == 200
    assert watcher.warm


def test_what_is_asked_for_is_counted() -> None:
    limits = Limits(batch=1)
    watcher = StubWatcher()

    import asyncio

    import httpx

    from service_client import lifespan

    async def ask() -> str:
        app = create_app(watcher, limits=limits)  # type: ignore[arg-type]
        async with (
            lifespan(app),
            httpx.AsyncClient(
                transport=httpx.ASGITransport(app), base_url="http://localhost"
            ) as client,
        ):
            await client.post("/frames", json=frame())
            await client.post("/outcomes", json=OUTCOME)
            await client.get("/no-such-route")
            await client.request("BREW", "/frames")
            return (await client.get("/metrics")).text

    text = asyncio.run(ask())
    for line in (
        'graspcast_decisions_total{action="attempt"} 1.0',
        'graspcast_outcomes_total{success="true"} 1.0',
        'graspcast_requests_total{method="POST",route="/frames",status="200"} 1.0',
        'graspcast_requests_total{method="GET",route="other",status="404"} 1.0',
        'graspcast_requests_total{method="other",route="/frames",status="405"} 1.0',
        "graspcast_batch_frames_count 1.0",
    ):
        assert line in text, line


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/frames", 405),
        ("DELETE", "/outcomes", 405),
        ("OPTIONS", "/frames", 405),
        ("POST", "/health", 405),
        ("HEAD", "/frames", 405),
        ("GET", "/", 404),
        ("GET", "/docs", 404),
        ("GET", "/frames/", 404),
        ("POST", "/episodes//looks", 404),
    ],
)
def test_other_methods_and_routes(method: str, path: str, status: int) -> None:
    (response,) = asked(StubWatcher(), (method, path, {}))
    assert response.status_code == status
    assert response.headers["content-type"] == "application/problem+json"
    assert (status == 405) == ("allow" in response.headers)


def test_a_token_is_needed_for_all_but_health() -> None:
    token = "correct-horse-battery"
    shown = {"Authorization": f"Bearer {token}"}
    responses = asked(
        StubWatcher(), get("/health"), get("/models"), get("/metrics"), get("/openapi.json"),
        post("/frames", frame()), get("/none"), post("/frames", frame(), headers=shown),
        get("/metrics", headers=shown), token=token,
    )  # fmt: skip
    assert [r.status_code for r in responses] == [200, 401, 401, 401, 401, 401, 200, 200]
    assert responses[1].headers["www-authenticate"] == "Bearer"


def test_web_pages_cannot_ask() -> None:
    """Neither by a name of their own nor with a type that browsers send to anyone."""
    body = {"content": json.dumps(OUTCOME)}
    elsewhere, plain, none = asked(
        watcher := StubWatcher(),
        post("/outcomes", OUTCOME, headers={"Host": "evil.example"}),
        ("POST", "/outcomes", {**body, "headers": {"Content-Type": "text/plain"}}),
        ("POST", "/outcomes", body),
    )
    assert [r.status_code for r in (elsewhere, plain, none)] == [421, 415, 415]
    assert not watcher.outcomes


def test_the_documentation_has_examples_that_are_answered() -> None:
    (response,) = asked(StubWatcher(), get("/openapi.json"))
    document = response.json()
    for name, path in (("FrameIn", "/frames"), ("OutcomeIn", "/outcomes")):
        (example,) = document["components"]["schemas"][name]["examples"]
        (response,) = asked(StubWatcher(), post(path, example))
        assert response.status_code == 200
    for path, operations in document["paths"].items():
        for operation in operations.values():
            assert operation["summary"], path
            assert operation["description"], path
            assert "HTTPValidationError" not in json.dumps(operation)


def test_the_monitors_alarm_is_shown() -> None:
    status = MonitorStatus(
        "all", alarm=True, alarm_at=7, e_value=30.0, max_e_value=31.0, attempts=9, successes=2,
        waiting=0, rate=0.9, alpha=0.05, outcomes_read=9, left_out={"late": 1},
    )  # fmt: skip
    without, counts = asked(StubWatcher(), get("/monitor"), get("/metrics"))
    assert (without.status_code, "graspcast_monitor_alarm" in counts.text) == (404, False)
    told, metrics = asked(StubWatcher(), get("/monitor"), get("/metrics"), monitor=lambda: status)
    assert MonitorOut.model_validate_json(told.content).alarm_at == 7
    assert "ALARM since attempt 7" in told.json()["message"]
    assert "graspcast_monitor_alarm 1.0" in metrics.text


def test_a_log_that_cannot_be_written_is_told() -> None:
    class Full(StubWatcher):
        def judge_all(self, frames: Any) -> list[Any]:
            return [self.full() for _ in frames]

        def outcome(self, *_: object) -> None:
            raise self.full()

        def full(self) -> InputError:
            error = InputError("the disk is full")
            error.__cause__ = sqlite3.OperationalError("full")
            return error

    responses = asked(Full(), post("/frames", frame()), post("/outcomes", OUTCOME))
    for response in responses:
        assert (response.status_code, response.json()["detail"]) == (503, "the disk is full")


def test_outcomes_need_a_log() -> None:
    class Forgetful(StubWatcher):
        def outcome(self, *_: object) -> None:
            raise InputError("this watcher has no log", parameters=("log",))

    (response,) = asked(Forgetful(), post("/outcomes", OUTCOME))
    assert response.status_code == 409
