"""Slow, large and broken requests over real connections, to a service in a process of its own."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator

import pytest

from service_client import Process, read_all, running, stub
from stub_watcher import frame

# A service in a process of its own, and time that passes.
pytestmark = pytest.mark.slow

HEAD = b"POST /frames HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
BODY = json.dumps(frame()).encode()
WHOLE = HEAD + b"Content-Length: %d\r\n\r\n" % len(BODY) + BODY


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Process]:
    limits = {"head_s": 0.3, "body_s": 0.3, "idle_s": 1, "connections": 8}
    command = stub(**limits, head_bytes=8192, body_bytes=100_000)
    with running(command, tmp_path_factory.mktemp("service")) as process:
        yield process


def status(answer: bytes) -> int:
    return int(answer.split()[1]) if answer else 0


@pytest.fixture(autouse=True)
def still_answers(service: Process) -> Iterator[None]:
    yield
    with socket.create_connection(service.address, timeout=20) as connection:
        connection.sendall(WHOLE.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n", 1))
        assert status(read_all(connection)) == 200


@pytest.mark.parametrize("sent", [b"", b"POST /frames HT", HEAD])
def test_a_head_that_does_not_end_is_answered_in_time(service: Process, sent: bytes) -> None:
    began = time.monotonic()
    answer = service.sent(sent)
    assert status(answer) == 408
    assert b"application/problem+json" in answer
    assert 0.2 < time.monotonic() - began < 5


def test_a_head_that_comes_byte_by_byte_is_not_waited_for(service: Process) -> None:
    with socket.create_connection(service.address, timeout=20) as connection:
        began = time.monotonic()
        try:
            while time.monotonic() - began < 5:
                connection.sendall(b"P" if time.monotonic() == began else b"O")
                time.sleep(0.05)
        except OSError:
            pass
        assert time.monotonic() - began < 4


@pytest.mark.parametrize(
    "framing", [b"Content-Length: 1000\r\n", b"Transfer-Encoding: chunked\r\n"]
)
def test_a_body_that_does_not_end_is_answered_in_time(service: Process, framing: bytes) -> None:
    answer = service.sent(HEAD + framing + b"\r\n" + b'5\r\n{"a":')
    assert status(answer) == 408
    assert answer.lower().count(b"connection: close") == 1


def test_an_idle_connection_is_closed_after_its_answer(service: Process) -> None:
    began = time.monotonic()
    answer = service.sent(WHOLE)
    assert status(answer) == 200
    assert 0.5 < time.monotonic() - began < 5


def test_a_second_request_may_be_as_slow_as_the_first(service: Process) -> None:
    answer = service.sent(WHOLE + b"POST")
    assert answer.count(b"HTTP/1.1 ") == 2
    assert b"HTTP/1.1 408" in answer


def test_requests_in_a_row_are_answered_in_order(service: Process) -> None:
    answer = service.sent(3 * WHOLE)
    assert answer.count(b"HTTP/1.1 200") == 3


@pytest.mark.parametrize(
    "sent",
    [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"GET\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET \xff\xfe HTTP/1.1\r\n\r\n",
        b"CONNECT localhost:1 HTTP/1.1\r\n\r\n",
        b"GET http:// HTTP/1.1\r\n\r\n",
        HEAD + b"Content-Length: -1\r\n\r\n",
        HEAD + b"Content-Length: 1\r\nContent-Length: 2\r\n\r\n",
        HEAD + b"Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
        HEAD + b"Transfer-Encoding: chunked\r\n\r\nxyz\r\n",
        HEAD + b"A\x00b: c\r\n\r\n",
    ],
)
def test_what_is_no_http_is_refused(service: Process, sent: bytes) -> None:
    assert 400 <= status(service.sent(sent)) < 500


@pytest.mark.parametrize(
    "more", [b"X: " + 8192 * b"a" + b"\r\n", b"X: " + 16_384 * b"a" + b"\r\n", 2000 * b"X: a\r\n"]
)
def test_a_large_head_is_refused_though_it_comes_at_once(service: Process, more: bytes) -> None:
    answer = service.sent(WHOLE.replace(b"\r\n", b"\r\n" + more, 1))
    assert status(answer) == 431
    assert b"line and headers exceed 8192 bytes" in answer


def test_a_request_without_a_host_is_refused(service: Process) -> None:
    answer = service.sent(WHOLE.replace(b"Host: localhost\r\n", b""))
    assert (status(answer), b"Host is missing" in answer) == (400, True)


@pytest.mark.parametrize(
    "head", [b"X: " + 100_000 * b"a", 10_000 * b"X: a\r\n", b"Cookie: " + 9_000 * b"a"]
)
def test_a_large_head_is_refused(service: Process, head: bytes) -> None:
    with socket.create_connection(service.address, timeout=20) as connection:
        connection.sendall(b"GET /health HTTP/1.1\r\n")
        time.sleep(0.05)
        try:
            for start in range(0, len(head), 4096):
                connection.sendall(head[start : start + 4096])
                answer = read_all(connection)
        except OSError:
            # Closed while it was still being sent to.
            return
    assert status(answer) in (0, 400, 408, 431)


def test_a_large_body_is_refused_by_its_length_and_by_what_comes(service: Process) -> None:
    field = b'{"length_unit": "' + 1_000_000 * b"m" + b'"}'
    stated = HEAD + b"Content-Length: %d\r\n\r\n" % len(field) + field
    chunked = HEAD + b"Transfer-Encoding: chunked\r\n\r\n"
    chunked += b"%x\r\n" % len(field) + field + b"\r\n0\r\n\r\n"
    for sent in (stated, chunked):
        answer = service.sent(sent)
        assert status(answer) == 413
        assert b"larger than 100000 bytes" in answer


def test_a_client_that_asks_first_is_told_before_it_sends(service: Process) -> None:
    sent = HEAD + b"Content-Length: 10000000\r\nExpect: 100-continue\r\n\r\n"
    answer = service.sent(sent)
    assert status(answer) == 413


def test_a_client_that_asks_first_may_send(service: Process) -> None:
    with socket.create_connection(service.address, timeout=20) as connection:
        head = HEAD + b"Expect: 100-continue\r\nContent-Length: %d\r\n\r\n" % len(BODY)
        connection.sendall(head)
        assert connection.recv(100).startswith(b"HTTP/1.1 100")
        connection.sendall(BODY)
        assert status(read_all(connection)) == 200


def test_a_client_that_leaves_is_forgotten(service: Process) -> None:
    for sent in (HEAD, HEAD + b"Content-Length: 100\r\n\r\n{", WHOLE):
        with socket.create_connection(service.address, timeout=20) as connection:
            connection.sendall(sent)


def test_more_connections_than_there_may_be_are_told_to_wait(service: Process) -> None:
    time.sleep(1.2)  # those of other tests are closed
    opened = [socket.create_connection(service.address, timeout=20) for _ in range(9)]
    try:
        time.sleep(0.1)
        answer = read_all(opened[-1])
        assert status(answer) == 503
        assert b"Retry-After" in answer
    finally:
        for connection in opened:
            connection.close()
    time.sleep(0.2)


def test_a_compressed_body_is_refused(service: Process) -> None:
    body = b"\x1f\x8b" + 20 * b"\x00"
    head = HEAD + b"Content-Encoding: gzip\r\nContent-Length: %d\r\n\r\n" % len(body)
    assert status(service.sent(head + body)) == 415


def test_an_upgrade_is_not_made(service: Process) -> None:
    head = b"GET /health HTTP/1.1\r\nHost: localhost\r\n"
    sent = b"Connection: Upgrade\r\nUpgrade: websocket\r\n\r\n"
    assert status(service.sent(head + sent)) in (200, 400)
