"""Downloads from servers that truncate, stall, lie, change and redirect."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import httpx
import pytest

from download_server import Handler, Reply, Server, cut, gzipped, raw, stalled, status, whole
from graspcast.errors import DownloadError, InputError
from graspcast.fetching.download import Downloaded, download
from graspcast.fetching.limits import Limits

CONTENT = bytes(range(256)) * 40  # 10,240 bytes
OTHER = CONTENT[::-1]
Load = Callable[..., Downloaded]


@pytest.fixture
def load(server: Server, tmp_path: Path, limits: Limits) -> Load:
    def run(
        *replies: Reply, most: int = 10**6, name: str = "a.zip", **changed: float
    ) -> Downloaded:
        url = server.give(name, *replies)
        return download(
            url,
            tmp_path / name,
            most_bytes=most,
            limits=replace(limits, **changed),  # type: ignore[arg-type]
            arrived=lambda size, length, remark: None,
        )

    return run


def test_a_file(load: Load) -> None:
    got = load(whole(CONTENT))
    assert got.path.read_bytes() == CONTENT
    assert got.sha256 == hashlib.sha256(CONTENT).hexdigest()
    assert got.stated == ""


@pytest.mark.parametrize("stall", [cut(CONTENT, 4000), stalled(CONTENT, 4000)])
def test_what_broke_off_or_stalled_goes_on_where_it_ended(
    load: Load, server: Server, stall: Reply
) -> None:
    assert load(stall, whole(CONTENT)).path.read_bytes() == CONTENT
    assert server.ranges("a.zip") == ["", "bytes=4000-"]
    assert server.asked[1][1]["if-range"] == '"v1"'


@pytest.mark.slow
def test_a_trickle_is_a_stall(load: Load) -> None:
    assert load(stalled(CONTENT, 4000, trickle=True), whole(CONTENT)).path.read_bytes() == CONTENT


def test_a_later_process_goes_on(load: Load, server: Server) -> None:
    with pytest.raises(DownloadError, match="4 kB are kept, and resumed next time"):
        load(cut(CONTENT, 4000), status(503))
    assert load(whole(CONTENT)).path.read_bytes() == CONTENT
    assert server.ranges("a.zip")[-1] == "bytes=4000-"


def test_a_server_that_ignores_ranges_sends_all_again(load: Load) -> None:
    got = load(cut(CONTENT, 4000), whole(CONTENT, ranges=False))
    assert got.path.read_bytes() == CONTENT


def test_a_file_that_changed_meanwhile_is_not_mixed(load: Load) -> None:
    got = load(cut(CONTENT, 4000), whole(OTHER, '"v2"'))
    assert got.path.read_bytes() == OTHER


def test_another_etag_on_the_rest_begins_anew(load: Load) -> None:
    wrong = raw(
        206, OTHER[4000:], ETag='"v2"', Content_Range=f"bytes 4000-{len(OTHER) - 1}/{len(OTHER)}"
    )
    assert load(cut(CONTENT, 4000), wrong, whole(OTHER, '"v2"')).path.read_bytes() == OTHER


def test_another_part_than_was_asked_for_begins_anew(load: Load) -> None:
    wrong = raw(206, CONTENT[3000:], Content_Range=f"bytes 3000-{len(CONTENT) - 1}/{len(CONTENT)}")
    assert load(cut(CONTENT, 4000), wrong, whole(CONTENT)).path.read_bytes() == CONTENT


@pytest.mark.parametrize("etag", ["", 'W/"weak"', '"\u00fc"'])
def test_without_a_strong_validator_nothing_is_resumed(
    load: Load, server: Server, etag: str
) -> None:
    assert load(cut(CONTENT, 4000, etag), whole(CONTENT, etag)).path.read_bytes() == CONTENT
    assert server.ranges("a.zip") == ["", ""]


def test_a_length_that_is_too_long_ends_in_an_error(load: Load) -> None:
    with pytest.raises(DownloadError, match="3 attempts in a row failed"):
        load(cut(CONTENT, len(CONTENT), "", says=20_000))


def test_what_had_all_arrived_is_whole(load: Load) -> None:
    """The server stated more than it has; its refusal of the rest says how much it has."""
    got = load(cut(CONTENT, len(CONTENT), says=20_000), whole(CONTENT))
    assert got.path.read_bytes() == CONTENT


def test_a_shorter_file_than_before_begins_anew(load: Load) -> None:
    short = CONTENT[:1000]
    refused = status(416, Content_Range="bytes */1000")
    assert load(cut(CONTENT, 4000), refused, whole(short, '"v2"')).path.read_bytes() == short


@pytest.mark.parametrize("name", ["a.zip", "b.bin"])
def test_a_packed_answer_is_unpacked(load: Load, name: str) -> None:
    assert load(gzipped(CONTENT), name=name).path.read_bytes() == CONTENT


def test_a_gz_file_that_is_called_packed_stays_as_it_is(load: Load) -> None:
    packed = gzipped(CONTENT)
    assert load(packed, name="a.tar.gz").path.read_bytes()[:2] == b"\x1f\x8b"


def test_a_packed_bomb_is_refused(load: Load, tmp_path: Path) -> None:
    with pytest.raises(DownloadError, match="larger than 1 MB"):
        load(gzipped(bytes(3_000_000)))
    assert not list(tmp_path.glob("a.zip*"))


def test_a_damaged_packing_is_tried_again(load: Load) -> None:
    broken = raw(200, b"\x1f\x8b broken", Content_Encoding="gzip")
    assert load(broken, whole(CONTENT)).path.read_bytes() == CONTENT


@pytest.mark.parametrize(
    "answer",
    [b"", b"220 mail.example.org ESMTP\r\n", b"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n",
     b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\nContent-Length: 6\r\n\r\n12345",
     b"HTTP/1.1 200 OK\r\nContent-Length: " + b"9" * 5000 + b"\r\n\r\n1",
     b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
     b"HTTP/1.1 206 Partial Content\r\nContent-Length: 1\r\n\r\n1", b"\0" * 200_000],
    ids=range(8),
)  # fmt: skip
def test_what_is_no_proper_answer(load: Load, answer: bytes) -> None:
    def reply(to: Handler) -> None:
        to.wfile.write(answer)
        to.close_connection = True

    with pytest.raises(DownloadError, match=r"127\.0\.0\.1.*a\.zip"):
        load(reply)


def test_temporary_errors_are_tried_again(load: Load) -> None:
    assert load(status(500), status(429), whole(CONTENT)).path.read_bytes() == CONTENT


@pytest.mark.parametrize(
    ("reply", "says"),
    [
        (status(404), "404: there is no such file"),
        (status(401), "401: it wants a login"),
        (status(204), "204: that is no file"),
        (status(500), "answered 500 .3 attempts in a row failed"),
        (status(503, Retry_After="7200"), "asks to wait 7200 s"),
        (
            status(302, Location="file:///etc/passwd"),
            "redirects to file:///etc/passwd, which",
        ),
        (status(302, Location="ftp://a/b"), "redirects to ftp://a/b"),
        (status(302), "redirects to"),
        (status(302, Location="/a.zip"), "more than 8 redirects"),
        (status(302, Location="http://[bad"), "redirects to"),
    ],
)
def test_what_cannot_be_had(load: Load, reply: Reply, says: str) -> None:
    with pytest.raises(DownloadError, match=says):
        load(reply)


def test_redirects_are_followed_and_state_the_digest(load: Load, server: Server) -> None:
    digest = hashlib.sha256(CONTENT).hexdigest()
    server.give("elsewhere", whole(CONTENT))
    got = load(status(302, Location="/elsewhere", X_Linked_ETag=f'"{digest}"'))
    assert got.stated == got.sha256 == digest


def test_a_wrong_stated_digest_is_an_error_and_nothing_is_kept(
    load: Load, server: Server, tmp_path: Path
) -> None:
    server.give("elsewhere", whole(CONTENT))
    with pytest.raises(DownloadError, match=r"and not 0000.* as the server states"):
        load(status(302, Location="/elsewhere", X_Linked_ETag="0" * 64))
    assert not list(tmp_path.glob("a.zip*"))


def test_size_limits(load: Load) -> None:
    with pytest.raises(DownloadError, match=r"is 10.2 kB, more than its limit of 5 kB"):
        load(whole(CONTENT), most=5000)


def test_a_full_disk_is_told_before(load: Load) -> None:
    with pytest.raises(InputError, match=r"are needed for a.zip, and .* are free"):
        load(whole(CONTENT), spare_bytes=10**18)


def test_progress_through_many_cuts(load: Load, server: Server) -> None:
    """Attempts are counted anew where each brings something."""

    def some(start: int) -> Reply:
        end = len(CONTENT) - 1
        return raw(
            206,
            CONTENT[start : start + 2000],
            ETag='"v1"',
            Content_Range=f"bytes {start}-{end}/{len(CONTENT)}",
        )

    cuts = [some(n) for n in (2000, 4000, 6000, 8000)]
    assert load(cut(CONTENT, 2000), *cuts, whole(CONTENT)).path.read_bytes() == CONTENT


def test_no_server(tmp_path: Path, limits: Limits) -> None:
    with pytest.raises(DownloadError, match="2 attempts in a row failed"):
        download(
            "http://127.0.0.1:1/a.zip",
            tmp_path / "a.zip",
            most_bytes=1,
            limits=limits,
            arrived=lambda *_: None,
        )


def test_passwords_are_not_shown(server: Server, tmp_path: Path, limits: Limits) -> None:
    url = (
        server.give("a.zip", status(404)).replace("http://", "http://me:secret@") + "?token=secret"
    )
    with pytest.raises(DownloadError) as caught:
        download(url, tmp_path / "a", most_bytes=1, limits=limits, arrived=lambda *_: None)
    assert "secret" not in str(caught.value)
    assert "secret" not in "".join(p.read_text() for p in tmp_path.glob("*"))


def test_a_proxy_that_cannot_be_used_is_named(load: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HTTP_PROXY", "nonsense://x:y")
    with pytest.raises(DownloadError, match="HTTP_PROXY"):
        load(whole(CONTENT))


def test_a_proxy_that_is_not_there_is_named(
    tmp_path: Path, limits: Limits, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HTTP_PROXY", "http://me:secret@127.0.0.1:1")
    with pytest.raises(DownloadError, match=r"through the proxy http://127.0.0.1:1"):
        download(
            "http://far.invalid/a.zip",
            tmp_path / "a.zip",
            most_bytes=10**6,
            limits=limits,
            arrived=lambda *_: None,
        )


def test_a_proxy_is_asked(
    server: Server, tmp_path: Path, limits: Limits, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HTTP_PROXY", server.url)
    server.replies["http://far.invalid/a.zip"] = [whole(CONTENT)]
    got = download(
        "http://far.invalid/a.zip",
        tmp_path / "a.zip",
        most_bytes=10**6,
        limits=limits,
        arrived=lambda *_: None,
    )
    assert got.path.read_bytes() == CONTENT


def test_what_another_process_has_downloaded_meanwhile_is_taken(
    load: Load, server: Server, tmp_path: Path
) -> None:
    first = load(whole(CONTENT))
    asked = len(server.asked)
    again = download(
        f"{server.url}/a.zip",
        tmp_path / "a.zip",
        most_bytes=10**6,
        limits=Limits(),
        arrived=lambda *_: None,
    )
    assert again == first and len(server.asked) == asked


def test_a_rest_that_is_longer_than_it_should_be_is_not_kept(load: Load) -> None:
    file = CONTENT[:5000]

    def too_much(to: Handler) -> None:
        to.head(206, ETag='"v1"', Content_Range="bytes 4000-4999/5000")
        to.wfile.write(OTHER[4000:])

    assert load(cut(file, 4000), too_much, whole(file)).path.read_bytes() == file


def test_a_mirror_s_file_that_cannot_be_read_is_named(
    tmp_path: Path, limits: Limits, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = tmp_path / "mirror.zip"
    source.write_bytes(CONTENT)
    real = Path.open

    def refuse(path: Path, *arguments: object, **named: object) -> object:
        if path == source:  # as for others than root
            raise PermissionError(13, "Permission denied")
        return real(path, *arguments, **named)  # type: ignore[call-overload]

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(DownloadError, match=r"mirror\.zip: cannot be read \(Permission denied\)"):
        download(
            source.as_uri(),
            tmp_path / "a.zip",
            most_bytes=10**6,
            limits=limits,
            arrived=lambda *_: None,
        )


def test_an_address_that_is_none_is_named(tmp_path: Path, limits: Limits) -> None:
    with pytest.raises(DownloadError, match="an address that cannot be read: Invalid port: 'x'"):
        download(
            "http://host:x/a.zip",
            tmp_path / "a.zip",
            most_bytes=1,
            limits=limits,
            arrived=lambda *_: None,
        )


def test_a_certificate_that_is_not_trusted_is_an_error_at_once(
    tmp_path: Path, limits: Limits, monkeypatch: pytest.MonkeyPatch
) -> None:
    attempts = []

    def refuse(self: httpx.Client, *_: object, **__: object) -> object:
        attempts.append(1)
        raise httpx.ConnectError("[SSL: CERTIFICATE_VERIFY_FAILED] self-signed certificate")

    monkeypatch.setattr(httpx.Client, "stream", refuse)
    with pytest.raises(DownloadError, match=r"certificate is not trusted .*; SSL_CERT_FILE names"):
        download(
            "https://far.invalid/a.zip",
            tmp_path / "a.zip",
            most_bytes=1,
            limits=limits,
            arrived=lambda *_: None,
        )
    assert len(attempts) == 1
