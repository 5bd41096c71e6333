from __future__ import annotations

import pytest

from graspcast.errors import InputError
from graspcast.service.access import Access, is_loopback, token_from
from graspcast.service.replies import RefusedError

TOKEN = "correct-horse-battery"


def test_the_token_is_the_environments() -> None:
    assert token_from({}) is None
    assert token_from({"GRASPCAST_TOKEN": TOKEN}) == TOKEN


@pytest.mark.parametrize("token", ["", "short", 20 * " ", "with a blank in it", 20 * "é"])
def test_a_token_that_cannot_protect_is_refused_and_not_told(token: str) -> None:
    with pytest.raises(InputError, match="GRASPCAST_TOKEN must hold 16 or more") as caught:
        token_from({"GRASPCAST_TOKEN": token})
    assert not token or token not in str(caught.value)


@pytest.mark.parametrize("given", [f"Bearer {TOKEN}", f"bearer {TOKEN}", f"BEARER  {TOKEN}"])
def test_who_shows_the_token_may_ask(given: str) -> None:
    Access(TOKEN).check({b"authorization": given.encode(), b"host": b"robot.example"})


@pytest.mark.parametrize("given", [None, "", TOKEN, "Bearer", f"Basic {TOKEN}", "Bearer \xff\xff"])
def test_who_does_not_may_not(given: str | None) -> None:
    headers = {} if given is None else {b"authorization": given.encode("latin-1")}
    with pytest.raises(RefusedError) as caught:
        Access(TOKEN).check(headers)
    assert caught.value.status == 401
    assert dict(caught.value.headers) == {"WWW-Authenticate": "Bearer"}


@pytest.mark.parametrize("host", ["localhost:8000", "127.0.0.1", "[::1]:8000", "LOCALHOST"])
def test_without_a_token_this_machine_may_ask(host: str) -> None:
    Access(None).check({b"host": host.encode()})


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example:80", "10.0.0.1", "[", ""])
def test_without_a_token_no_other_name_serves(host: str) -> None:
    with pytest.raises(RefusedError) as caught:
        Access(None).check({b"host": host.encode()})
    assert caught.value.status == 421


def test_loopback() -> None:
    assert all(map(is_loopback, ("127.0.0.1", "127.1.2.3", "::1", "localhost")))
    assert not any(map(is_loopback, ("0.0.0.0", "::", "192.168.0.1", "robot", "")))
