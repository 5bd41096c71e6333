"""The verb fetch: its output and mistakes; processes killed, and several at once."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import graspcast
from bop_archives import MODELS, mirror
from download_server import serving, stalled, status, whole
from graspcast.bop.dataset import BopDataset
from graspcast.cli import main, parser
from graspcast.fetching.limits import Limits

SOURCE = str(Path(graspcast.__file__).parents[1])
Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GRASPCAST_CACHE", str(tmp_path / "cache"))
    for name in ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "GRASPCAST_OFFLINE"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.lower(), raising=False)


@pytest.fixture
def start(tmp_path: Path) -> Start:
    def run(*arguments: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "graspcast", "fetch", *arguments],
            env={**os.environ, "PYTHONPATH": SOURCE},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    return run


def wait_for(there: Callable[[], bool]) -> None:
    due = time.monotonic() + 60
    while not there():
        assert time.monotonic() < due
        time.sleep(0.01)


def test_the_list(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["fetch", "--list", "--json", str(tmp_path / "list.json")]) == 0
    out = capsys.readouterr().out
    assert "lmo-models" in out
    assert "CC BY-SA 4.0" in out
    items = json.loads((tmp_path / "list.json").read_text())["items"]
    assert {item["item"] for item in items} >= {"release", "lmo", "ycbv-images"}
    assert not items[0]["in_cache"]


def test_models_from_a_mirror(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    source = str(mirror(tmp_path / "mirror"))
    facts = tmp_path / "facts.json"
    assert main(["fetch", "lmo-models", "--mirror", source, "--json", str(facts)]) == 0
    out, err = capsys.readouterr()
    path = tmp_path / "cache" / "fetched" / "lmo"
    assert out == f"{path}\n"  # alone, for $(graspcast fetch lmo-models)
    assert err.index("under CC BY-SA 4.0") < err.index("lmo_base.zip: 2 files")
    assert f"next: graspcast errors --bop {path}" in err
    (item,) = json.loads(facts.read_text())["items"]
    assert item["path"] == str(path)
    assert item["archives"][0]["downloaded"] is True
    assert BopDataset(path).root == path
    assert main(["fetch", "lmo-models", "--offline"]) == 0
    assert "in the cache, verified" in capsys.readouterr().err


@pytest.mark.parametrize("item", ["lmo-models", "lmo-images", "lmo"])
def test_the_next_command_is_one(
    item: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["fetch", item, "--mirror", str(mirror(tmp_path / "mirror"))]) == 0
    line = capsys.readouterr().err.splitlines()[-1]
    words = shlex.split(line.removeprefix("next: graspcast ").replace("NAME=FILE", "a=b.csv"))
    options = parser().parse_args(words)
    assert str(tmp_path / "cache" / "fetched" / "lmo") in str(options.bop)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "name what to fetch, for example lmo-models (see --list)"),
        (["lmo_models"], "unknown item 'lmo_models' (did you mean 'lmo-models'?)"),
        (["lmo", "--list"], "no item is needed"),
        (["lmo", "--offline"], "lmo_base.zip: is not cached"),
        (["lmo", "--mirror", "ftp://host"], "ftp:// is not supported"),
        (["lmo", "--mirror", "/nowhere"], "no such file in the mirror (see --mirror)"),
    ],
)
def test_mistakes(capsys: pytest.CaptureFixture[str], arguments: list[str], says: str) -> None:
    assert main(["fetch", *arguments]) == 2
    assert says in capsys.readouterr().err.replace("\n", " ")


def test_without_httpx_the_pip_line_is_told(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "httpx", None)
    assert main(["fetch", "lmo-models"]) == 2
    assert "pip install 'graspcast[fetch]'" in capsys.readouterr().err


@pytest.mark.slow
def test_killed_in_a_download_and_started_again(start: Start, tmp_path: Path) -> None:
    archive = {p.name: p.read_bytes() for p in mirror(tmp_path / "mirror").iterdir()}
    models = archive["lmo_models.zip"]
    part = tmp_path / "cache" / "fetched" / "downloads" / "lmo_models.zip.part"
    with serving() as server:
        server.give("lmo_base.zip", whole(archive["lmo_base.zip"]))
        server.give("lmo_models.zip", stalled(models, 1000), whole(models))
        first = start("lmo-models", "--mirror", server.url)
        wait_for(lambda: part.exists() and part.stat().st_size == 1000)
        first.kill()
        first.communicate()
        again = start("lmo-models", "--mirror", server.url)
        out, err = again.communicate(timeout=120)
        assert again.returncode == 0, err
        assert server.ranges("lmo_models.zip") == ["", "bytes=1000-"]
    folder = Path(out.strip())
    assert (folder / "models" / "obj_000001.ply").read_bytes() == MODELS["models/obj_000001.ply"]
    assert not part.exists()


_KILLED_AT = """
import os, signal, sys
from graspcast.fetching import fetch as module, store
target = {"unpack": (module, "unpack"), "place": (store.Store, "place"),
          "receipt": (store, "write_artefact"), "sweep": (store.Store, "sweep")}[sys.argv[1]]
whole = getattr(*target)
def killed(*arguments, **options):
    if sys.argv[1] == "unpack":
        whole(*arguments, **options)
    os.kill(os.getpid(), signal.SIGKILL)
setattr(*target, killed)
from graspcast.cli import main, parser
main(["fetch", "lmo-models", "--mirror", sys.argv[2]])
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL: run it on Linux or macOS")
@pytest.mark.parametrize("at", ["unpack", "place", "receipt", "sweep"])
def test_killed_at_any_step_and_started_again(tmp_path: Path, at: str) -> None:
    source = str(mirror(tmp_path / "mirror"))
    done = subprocess.run(
        [sys.executable, "-c", _KILLED_AT, at, source],
        env={**os.environ, "PYTHONPATH": SOURCE},
        capture_output=True,
    )
    assert done.returncode == -signal.SIGKILL
    assert main(["fetch", "lmo-models", "--mirror", source]) == 0
    root = tmp_path / "cache" / "fetched"
    assert {p.name for p in root.iterdir()} == {"downloads", "lmo", "locks", "receipts"}
    assert not list((root / "downloads").iterdir())
    assert {p.name for p in (root / "lmo").iterdir()} == {
        "camera.json",
        "models",
        "test_targets_bop19.json",
    }


@pytest.mark.slow
def test_two_processes_at_once(start: Start, tmp_path: Path) -> None:
    archive = {p.name: p.read_bytes() for p in mirror(tmp_path / "mirror").iterdir()}
    with serving() as server:
        for name, content in archive.items():
            server.give(name, whole(content))
        running = [start("lmo-models", "--mirror", server.url) for _ in range(3)]
        told = [process.communicate(timeout=120) for process in running]
        assert [process.returncode for process in running] == [0, 0, 0], told
        assert len({out for out, _ in told}) == 1
        assert sorted(path for path, _ in server.asked) == ["/lmo_base.zip", "/lmo_models.zip"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT: run it on Linux or macOS")
def test_interrupted(start: Start, tmp_path: Path) -> None:
    with serving() as server:
        server.give("lmo_base.zip", stalled(b"x" * 5000, 1000))
        process = start("lmo-models", "--mirror", server.url)
        wait_for(lambda: bool(server.asked))
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "graspcast fetch: interrupted" in err


def test_a_server_that_fails(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("graspcast.fetching.fetch.Limits", lambda: Limits(backoff_s=0.01))
    with serving() as server:
        server.give("lmo_base.zip", status(503))
        assert main(["fetch", "lmo", "--mirror", server.url]) == 2
    assert "the server answered 503 (5 attempts in a row failed)" in capsys.readouterr().err
