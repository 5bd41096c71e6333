"""Access: who may ask, by a bearer token or from the same machine alone."""

from __future__ import annotations

import hmac
import os
from collections.abc import Mapping
from ipaddress import ip_address

from graspcast.errors import InputError
from graspcast.service.replies import RefusedError

__all__ = ["TOKEN_VARIABLE", "Access", "is_loopback", "token_from"]

TOKEN_VARIABLE = "GRASPCAST_TOKEN"
_LEAST = 16


def token_from(environment: Mapping[str, str] = os.environ) -> str | None:
    """Return the token that clients must show, from the environment; None if there is none.

    Raises
    ------
    InputError
        For a token that is short, or has characters that a header cannot hold.
    """
    token = environment.get(TOKEN_VARIABLE)
    if token is None:
        return None
    if len(token) < _LEAST or not all("!" <= letter <= "~" for letter in token):
        raise InputError(
            f"the environment variable {TOKEN_VARIABLE} must hold {_LEAST} or more visible ASCII "
            f"characters without blanks, but has {len(token)} characters; for example of "
            "python -c 'import secrets; print(secrets.token_urlsafe())'"
        )
    return token


def is_loopback(host: str) -> bool:
    """Return whether a host is this machine, as seen from itself alone."""
    if host.lower() == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


class Access:
    """Who may ask: those who show the token; without one, whoever asks this machine by its name.

    Without a token the service is for programs on this machine. A web page that is open here could
    ask as well, by a name of its own that leads to this machine (DNS rebinding); so other names
    than those of the loopback are refused.

    Parameters
    ----------
    token
        What clients must show; None if nothing.
    """

    def __init__(self, token: str | None):
        self._expected = None if token is None else f"Bearer {token}".encode()

    def check(self, headers: Mapping[bytes, bytes]) -> None:
        """Raise unless a request may be answered.

        Raises
        ------
        RefusedError
            With status 401 for a missing or wrong token, and 421 for another host's name.
        """
        if self._expected is not None:
            given = headers.get(b"authorization", b"")
            scheme, _, rest = given.partition(b" ")
            shown = scheme.capitalize() + b" " + rest.strip()
            if not hmac.compare_digest(shown, self._expected):
                raise RefusedError(
                    401,
                    "a token is needed: the header 'Authorization: Bearer TOKEN', with the token "
                    "that the service was started with",
                    headers=(("WWW-Authenticate", "Bearer"),),
                )
        elif not is_loopback(_name(headers.get(b"host", b"localhost"))):
            raise RefusedError(
                421,
                "without a token the service answers under this machine's own names alone: "
                "localhost, 127.0.0.1, [::1]",
            )


def _name(host: bytes) -> str:
    """Return a Host header without its port."""
    text = host.decode("latin-1").strip()
    if text.startswith("["):
        return text[1:].partition("]")[0]
    return text.rpartition(":")[0] if text.count(":") == 1 else text
