"""HTTP requests: redirects followed with care, and answers that say what they are."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit
from urllib.request import getproxies

from graspcast._version import __version__
from graspcast.errors import DownloadError
from graspcast.fetching.addresses import redirected, shown
from graspcast.fetching.limits import Limits
from graspcast.fetching.partial_file import Version
from graspcast.io.extras import require

__all__ = ["Answer", "TryAgainError", "client", "get"]

_REDIRECTS = (301, 302, 303, 307, 308)
_LENGTH = re.compile(r"[0-9]{1,18}")
_DIGEST = re.compile(r'"?([0-9a-fA-F]{64})"?')


class TryAgainError(Exception):
    """An attempt failed in a way that another may not.

    Parameters
    ----------
    reason
        What happened.
    wait_s
        How long the server asks to be left alone.
    answered
        Whether a server answered.
    """

    def __init__(self, reason: str, *, wait_s: float = 0.0, answered: bool = True):
        super().__init__(reason)
        self.reason, self.wait_s, self.answered = reason, wait_s, answered


@dataclass(frozen=True)
class Answer:
    """An answer, whose body has not been read yet.

    Attributes
    ----------
    response
        The answer of httpx.
    url
        Where it came from in the end.
    stated_sha256
        Digest of the file as a redirect of Hugging Face states it; empty where none did.
    """

    response: Any
    url: str
    stated_sha256: str

    @property
    def status(self) -> int:
        """The status code."""
        return int(self.response.status_code)

    def header(self, name: str) -> str:
        """Return a header; empty where there is none."""
        return str(self.response.headers.get(name, ""))

    @property
    def encoding(self) -> str:
        """In what the body is packed for the way; empty where it is not."""
        encoding = self.header("content-encoding").strip().lower()
        return "" if encoding == "identity" else encoding

    @property
    def content_length(self) -> int | None:
        """Bytes of the body, as stated."""
        text = self.header("content-length")
        return int(text) if _LENGTH.fullmatch(text) else None

    @property
    def content_range(self) -> tuple[int, int | None] | None:
        """From which byte the body is, and of how many in all, as stated."""
        found = re.fullmatch(
            r"bytes ([0-9]{1,18})-[0-9]{1,18}/([0-9]{1,18}|\*)",
            self.header("content-range").strip(),
        )
        return found and (int(found[1]), None if found[2] == "*" else int(found[2]))

    @property
    def unsatisfied_length(self) -> int | None:
        """Bytes in all, of a refusal to answer with a range."""
        found = re.fullmatch(r"bytes \*/([0-9]{1,18})", self.header("content-range").strip())
        return found and int(found[1])

    def version(self, length: int | None) -> Version:
        """Return the version of which it is."""
        return Version(self.header("etag"), self.header("last-modified"), length)

    @property
    def retry_after_s(self) -> float:
        """How long the server asks to be left alone."""
        text = self.header("retry-after").strip()
        return float(text) if _LENGTH.fullmatch(text) else 0.0


def _proxy(url: str) -> str:
    """Name the proxy of the environment through which an address is asked for, if any."""
    proxies = getproxies()
    proxy = proxies.get(urlsplit(url).scheme) or proxies.get("all")
    return f", through the proxy {shown(proxy)}" if proxy else ""


@contextmanager
def client(limits: Limits) -> Iterator[Any]:
    """Yield a client that takes proxies and certificates from the environment.

    Raises
    ------
    ExtraMissingError
        If httpx is not installed.
    DownloadError
        If the environment names a proxy that cannot be used.
    """
    require("fetch")
    import httpx

    timeout = httpx.Timeout(limits.stall_s, connect=limits.connect_s)
    try:
        opened = httpx.Client(
            timeout=timeout,
            follow_redirects=False,
            headers={"User-Agent": f"graspcast/{__version__}", "Accept-Encoding": "identity"},
        )
    except (ImportError, ValueError, OSError, httpx.InvalidURL) as error:
        raise DownloadError(
            f"the environment's proxy or certificates cannot be used: {error} (HTTPS_PROXY, "
            "HTTP_PROXY, ALL_PROXY, NO_PROXY, SSL_CERT_FILE)"
        ) from error
    with opened as http:
        yield http


@contextmanager
def get(http: Any, url: str, headers: Mapping[str, str], limits: Limits) -> Iterator[Answer]:
    """Yield the answer to a request, after all redirects.

    Raises
    ------
    TryAgainError
        If the connection failed, here or while the block reads.
    DownloadError
        If a redirect leads where it must not, or in a circle.
    """
    require("fetch")
    import httpx

    at, stated, answered = url, "", False
    try:
        for _ in range(limits.redirects + 1):
            with http.stream("GET", at, headers=dict(headers)) as response:
                answered = True
                if response.status_code not in _REDIRECTS:
                    yield Answer(response, at, stated)
                    return
                linked = _DIGEST.fullmatch(response.headers.get("x-linked-etag", ""))
                stated = linked[1].lower() if linked else stated
                at = redirected(at, response.headers.get("location", ""))
    except (httpx.InvalidURL, httpx.UnsupportedProtocol) as error:
        raise DownloadError(f"{shown(url)}: {error}") from error
    except httpx.TimeoutException as error:
        reason = "the server has not answered in time" + ("" if answered else _proxy(at))
        raise TryAgainError(reason, answered=answered) from error
    except httpx.RequestError as error:
        if "CERTIFICATE_VERIFY_FAILED" in str(error):
            raise DownloadError(
                f"{shown(url)}: the server's certificate is not trusted ({error}); SSL_CERT_FILE "
                "names the certificates of a proxy of your own"
            ) from error
        reason = str(error) or type(error).__name__
        raise TryAgainError(reason + ("" if answered else _proxy(at)), answered=answered) from error
    raise DownloadError(
        f"{shown(url)}: more than {limits.redirects} redirects", parameters=("mirror",)
    )
