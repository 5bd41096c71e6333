from __future__ import annotations

import json
import logging

import pytest

from graspcast.service.limits import Limits
from service_client import asked
from stub_watcher import StubWatcher, frame

BODY = json.dumps(frame()).encode()
JSON = {"Content-Type": "application/json"}


def test_a_request_is_logged_without_its_payload(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "graspcast.service.edge")
    token = "correct-horse-battery"
    headers = {"Authorization": f"Bearer {token}", **JSON}
    asked(
        StubWatcher(),
        ("POST", "/frames", {"content": BODY, "headers": headers}),
        ("POST", "/episodes/secret/looks", {"content": BODY, "headers": headers}),
        ("GET", "/made/up/by/a/client?a=b", {"headers": headers}),
        token=token,
    )
    told = sorted((r.fields for r in caplog.records), key=lambda f: f["route"])
    assert [f["route"] for f in told] == ["/episodes/{episode}/looks", "/frames", "other"]
    assert {k: told[1][k] for k in ("status", "frames", "decisions", "attempts")} == {
        "status": 200, "frames": 1, "decisions": 1, "attempts": 1,
    }  # fmt: skip
    text = repr([r.__dict__ for r in caplog.records])
    assert not any(word in text for word in (token, "secret", "made", "ycbv"))


@pytest.mark.parametrize("path", ["/frames", "/episodes/1/looks", "/outcomes", "/none"])
def test_no_route_takes_more_than_the_limit(path: str) -> None:
    async def parts():  # type: ignore[no-untyped-def]
        for _ in range(3):
            yield 1000 * b" "

    stated = {"content": 3000 * b" ", "headers": JSON}
    chunked = {"content": parts(), "headers": JSON}
    responses = asked(
        StubWatcher(),
        ("POST", path, stated),
        ("POST", path, chunked),
        limits=Limits(body_bytes=2500),
    )
    assert [r.status_code for r in responses] == [413, 413]
    assert responses[0].headers["connection"] == "close"


def test_a_body_as_large_as_the_limit_is_taken() -> None:
    content = BODY + (10_000 - len(BODY)) * b" "
    request = ("POST", "/frames", {"content": content, "headers": JSON})
    (response,) = asked(StubWatcher(), request, limits=Limits(body_bytes=10_000))
    assert response.status_code == 200


@pytest.mark.parametrize(
    "content",
    [
        b"", b"{", b"null", b"[]", b"0", b'"x"', b"\x00", b"\xff", b"NaN", b"[" * 100_000,
        b'{"a":' * 100_000, b'{"length_unit": "m", "length_unit": "m"}', b"{}" + 100 * b"}",
        b'{"estimates": 1e999}', b'{"decision_id": "\\ud800", "success": true}',
        b'{"decision_id": "' + 900_000 * b"x" + b'", "success": true}',
        b'{"' + 900_000 * b"x" + b'": 1}', b"[" + 300_000 * b"1," + b"1]", b"-" + 9_000 * b"9",
    ],
)  # fmt: skip
def test_malformed_bodies_are_the_clients_fault(content: bytes) -> None:
    paths = ("/frames", "/outcomes", "/episodes/1/looks")
    responses = asked(
        StubWatcher(), *[("POST", path, {"content": content, "headers": JSON}) for path in paths]
    )
    for response in responses:
        assert response.status_code in (400, 422)
        assert len(response.content) < 5000
        assert response.json()["detail"]


@pytest.mark.slow
def test_what_the_service_could_not_do_is_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, "graspcast.service.edge")
    request = ("POST", "/frames", {"content": BODY, "headers": JSON})
    asked(StubWatcher(seconds=0.2), *[request] * 20, limits=Limits(waiting=5, batch=2))
    told = [r.fields for r in caplog.records]
    assert told and {f["status"] for f in told} == {503}
    assert all("wait" in f["detail"] for f in told), told[0]


@pytest.mark.slow
def test_too_much_at_once_is_told_to_wait() -> None:
    watcher = StubWatcher(seconds=0.2)
    request = ("POST", "/frames", {"content": BODY, "headers": JSON})
    responses = asked(watcher, *[request] * 20, limits=Limits(waiting=5, batch=2))
    statuses = [r.status_code for r in responses]
    assert set(statuses) == {200, 503}
    refused = responses[statuses.index(503)]
    assert refused.headers["retry-after"] == "1"
