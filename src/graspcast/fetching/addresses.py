"""Addresses: which are allowed, where a redirect may lead, and how one is shown."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote, unquote, urljoin, urlsplit, urlunsplit
from urllib.request import url2pathname

from graspcast.errors import DownloadError, InputError

__all__ = ["below", "local_path", "redirected", "shown"]

_SCHEMES = ("https", "http", "file")


def shown(url: str) -> str:
    """Return an address as messages and records show it: without user, password and query."""
    try:
        parts = urlsplit(url)
        host = parts.hostname or ""
        host = f"[{host}]" if ":" in host else host
        place = f"{host}:{parts.port}" if parts.port else host
    except ValueError:
        return "an address that cannot be read"
    return urlunsplit((parts.scheme, place, parts.path, "", ""))


def below(mirror: str, name: str) -> str:
    """Return the address of a file of a mirror.

    Parameters
    ----------
    mirror
        ``https://``, ``http://`` or ``file://``, or a directory.
    name
        The file's name.

    Raises
    ------
    InputError
        If the mirror is none of these.
    """
    scheme = mirror.partition("://")[0].lower() if "://" in mirror else ""
    if not scheme:
        return (Path(mirror).expanduser().absolute() / name).as_uri()
    problem = "" if scheme in _SCHEMES else f"{scheme}:// is not supported"
    try:
        parts = urlsplit(mirror)
        problem = problem or ("" if scheme == "file" or parts.hostname else "it names no host")
        _ = parts.port
    except ValueError as error:
        problem = str(error)
    if problem:
        raise InputError(
            f"the mirror {shown(mirror)}: {problem}; give https://…, http://…, file://… or a "
            "directory that holds the archives",
            parameters=("mirror",),
        )
    path = f"{parts.path.rstrip('/')}/{quote(name)}"
    return urlunsplit((scheme, parts.netloc, path, parts.query, ""))


def local_path(url: str) -> Path | None:
    """Return the path of a ``file://`` address; None for others."""
    parts = urlsplit(url)
    if parts.scheme != "file":
        return None
    host = f"//{parts.netloc}" if parts.netloc not in ("", "localhost") else ""
    return Path(url2pathname(f"{host}{parts.path}") if host else url2pathname(parts.path))


def redirected(url: str, location: str) -> str:
    """Return where a redirect leads.

    Raises
    ------
    DownloadError
        If that is not https, and not http where the address was http already.
    """
    try:
        target = urljoin(url, location)
        parts = urlsplit(target)
        scheme, host = parts.scheme.lower(), parts.hostname
        _ = parts.port
    except ValueError:
        scheme, host, target = "", None, "an address that cannot be read"
    allowed = ("https",) if urlsplit(url).scheme == "https" else ("https", "http")
    if scheme not in allowed or not host or not location.strip():
        raise DownloadError(
            f"{shown(url)}: redirects to {shown(unquote(target)) or 'nowhere'}, which is not "
            f"followed (only {' and '.join(allowed)})",
            parameters=("mirror",),
        )
    return target
