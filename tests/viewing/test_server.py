"""The page in the browser: served on loopback, played, closed; odd addresses."""

from __future__ import annotations

import socket
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from graspcast.errors import ExtraMissingError, InputError
from graspcast.simulation.trial.recording import Recording
from graspcast.simulation.trial.trial import TrialRunner
from graspcast.viewing.scene import Scene
from graspcast.viewing.trial_scene import trial_scene

pytest.importorskip("viser", reason="install it: pip install 'graspcast[view]'")

from graspcast.viewing.server import ViewServer

CHROMIUM = Path("/usr/bin/chromium")


@pytest.fixture(scope="module")
def scene(runner: TrialRunner, held: Recording) -> Scene:
    return trial_scene(held, runner.grasp_object, runner.gripper, "a cube <b>")


@pytest.fixture
def server(scene: Scene) -> Iterator[ViewServer]:
    with ViewServer(scene, port=0) as server:
        yield server


def test_the_page_is_served_on_loopback_until_it_is_closed(
    scene: Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    with ViewServer(scene, port=0) as server:
        assert server.url == f"http://127.0.0.1:{server.port}" and server.port > 0
        with urllib.request.urlopen(server.url, timeout=20) as answer:
            assert answer.status == 200 and b"<html" in answer.read()
    server.close()
    with pytest.raises(OSError):
        urllib.request.urlopen(server.url, timeout=2)
    out, err = capsys.readouterr()
    assert out == "" and err == "", "the library prints nothing"


def test_a_port_that_is_taken_is_named(scene: Scene) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port}: cannot be listened at"):
            ViewServer(scene, port=port)


@pytest.mark.parametrize(
    ("host", "port"), [("nowhere.invalid", 0), ("203.0.113.1", 0), ("127.0.0.1", 70_000)]
)
def test_an_address_that_is_not_ours_is_named(scene: Scene, host: str, port: int) -> None:
    with pytest.raises(InputError, match="cannot be listened at") as caught:
        ViewServer(scene, host=host, port=port)
    assert caught.value.parameters == ("host", "port")


def test_without_viser_the_pip_line_is_named(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(ExtraMissingError, match=r"pip install 'graspcast\[view\]'"):
        ViewServer(scene, port=0)


@pytest.mark.slow
def test_the_trial_is_played_in_a_browser(server: ViewServer) -> None:
    sync = pytest.importorskip("playwright.sync_api", reason="pip install playwright")
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is needed: apt-get install chromium")
    errors: list[str] = []
    hosts: set[str] = set()
    with sync.sync_playwright() as play:
        arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        arguments += ["--disable-quic", "--no-first-run", "--disable-background-networking"]
        browser = play.chromium.launch(executable_path=str(CHROMIUM), args=arguments)
        page: Any = browser.new_page(viewport={"width": 480, "height": 360})
        page.set_default_timeout(120_000)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: hosts.add(request.url.split("/")[2]))
        page.goto(server.url)
        page.get_by_text("a cube <b>").wait_for()
        page.get_by_text("Play", exact=True).click()
        page.get_by_text("Stop", exact=True).wait_for()
        page.get_by_text("Play", exact=True).wait_for()
        shown = page.locator("input:disabled").input_value()
        browser.close()
    assert shown == "lift", "the phase at the end"
    assert errors == []
    assert hosts == {f"127.0.0.1:{server.port}"}, "nothing is loaded from elsewhere"
