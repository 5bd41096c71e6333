from __future__ import annotations

import json
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from commands import refused
from graspcast.attempt_log.log import AttemptLog
from graspcast.cli import main
from graspcast.demo_data import demo_model
from graspcast.runtime.frame import Estimate, Frame
from graspcast.runtime.watcher import Watcher
from service_client import ENVIRONMENT, Process, running
from stub_watcher import POSE, frame

JSON = {"Content-Type": "application/json"}
SERVE = ["-m", "graspcast", "serve", "--model", "demo", "--port", "0", "--threshold", "0.5"]


def test_what_cannot_be_is_refused_at_once(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    serve = ["serve", "--model", "demo"]
    monkeypatch.delenv("GRASPCAST_TOKEN", raising=False)
    assert "(see --host)" in refused([*serve, "--host", "0.0.0.0"], capsys)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert "cannot listen there" in refused([*serve, "--port", port], capsys)
    free = ["--port", "0"]
    missing = str(tmp_path / "model.npz")
    assert missing in refused(["serve", "--model", missing, *free], capsys)
    certificate = ["--certificate", missing]
    both = refused([*serve, *free, "--threshold", "0.5", *certificate], capsys)
    assert "exclude each other" in both
    monkeypatch.setenv("GRASPCAST_TOKEN", "short")
    assert "GRASPCAST_TOKEN must hold 16" in refused([*serve, *free], capsys)


@pytest.mark.parametrize("port", ["-1", "65536", "x", ""])
def test_a_port_is_a_number(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["serve", "--model", "demo", "--port", port])
    assert "0 to 65535" in capsys.readouterr().err


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("serve")


@pytest.fixture(scope="module")
def service(folder: Path) -> Iterator[Process]:
    with running([*SERVE, "--log", str(folder / "attempts.log")], folder) as process:
        yield process


@pytest.fixture
def client(service: Process) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=service.url, timeout=60) as made:
        yield made


@pytest.fixture(scope="module")
def watcher() -> Watcher:
    return Watcher.load(demo_model(), threshold=0.5)


def moved(metres: float, by: float) -> list[list[float]]:
    pose = POSE.copy()
    pose[:3, 3] += metres, 0, by
    return [[float(x) for x in row] for row in pose]


def scene(shift: float, *, across: float = 0.0, **changes: Any) -> dict[str, Any]:
    names = ("dense", "direct", "keypoints")
    found = {
        name: [{"object": "ycbv-5", "cam_T_obj": moved(0.002 * i + across, shift * i)}]
        for i, name in enumerate(names)
    }
    return frame(**{"estimates": found, **changes})


def as_frame(request: dict[str, Any]) -> Frame:
    import numpy as np

    found = {
        name: [Estimate(e["object"], np.array(e["cam_T_obj"])) for e in estimates]
        for name, estimates in request["estimates"].items()
    }
    camera = request.get("world_T_cam")
    return Frame(found, None if camera is None else np.array(camera))


@pytest.mark.slow
def test_verdicts_are_those_of_the_library(client: httpx.Client, watcher: Watcher) -> None:
    """One look, and two looks of an episode, with the same numbers as in this process."""
    first, second = (
        scene(0.01, world_T_cam=moved(0, 0)),
        scene(0.02, across=-0.3, world_T_cam=moved(0.3, 0)),
    )
    told = client.post("/frames", json=first).json()
    mine = watcher.judge(as_frame(first))
    looked = client.post(f"/episodes/{told['episode']}/looks", json=second).json()
    again = watcher.judge(as_frame(second), episode=mine.episode)
    for answer, known in ((told, mine), (looked, again)):
        assert answer["look"] == known.look
        assert len(answer["decisions"]) == len(known.decisions) == 1
        for decision, other in zip(answer["decisions"], known.decisions, strict=True):
            for name in ("action", "probability", "threshold", "reason", "guide", "grasp", "looks"):
                assert decision[name] == getattr(other, name), name
            assert other.cam_T_obj is not None
            assert decision["cam_T_obj"]["matrix"] == other.cam_T_obj.tolist()


@pytest.mark.slow
def test_outcomes_are_recorded_once(client: httpx.Client, folder: Path) -> None:
    told = client.post("/frames", json=scene(0.0)).json()
    name = told["decisions"][0]["id"]
    outcome = {"decision_id": name, "success": False, "reason": "slip"}
    assert [client.post("/outcomes", json=outcome).status_code for _ in range(2)] == [200, 200]
    other = client.post("/outcomes", json={**outcome, "success": True})
    assert other.status_code == 409
    unknown = client.post("/outcomes", json={**outcome, "decision_id": "no"})
    assert unknown.status_code == 404
    with AttemptLog.read(folder / "attempts.log") as log:
        recorded = log.outcomes()
        assert recorded["success"].to_list()[-1] is False
        assert recorded["decision_id"].to_list().count(name) == 1


@pytest.mark.slow
def test_unknown_names_and_episodes_are_told(client: httpx.Client) -> None:
    unknown = client.post("/frames", json=scene(0.0, estimates={"none": []}))
    assert (unknown.status_code, "unknown estimator 'none'" in unknown.text) == (422, True)
    assert client.post("/episodes/none/looks", json=scene(0.0)).status_code == 404
    assert client.delete("/episodes/none").status_code == 404
    told = client.post("/frames", json=scene(0.0)).json()
    assert client.delete(f"/episodes/{told['episode']}").status_code == 204
    assert client.post(f"/episodes/{told['episode']}/looks", json=scene(0.0)).status_code == 404


@pytest.mark.slow
def test_what_judges_is_told(client: httpx.Client) -> None:
    told = client.get("/models").json()
    (model,) = told["models"]
    assert sorted(told["estimators"]) == ["dense", "direct", "keypoints"]
    assert "ycbv-5" in model["objects"]
    assert (model["threshold"], model["guarantee"], told["records"]) == (0.5, None, True)


@pytest.mark.slow
def test_a_second_service_on_the_same_log_is_refused(service: Process, folder: Path) -> None:
    command = [sys.executable, *SERVE, "--log", str(folder / "attempts.log")]
    second = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT)
    assert second.returncode == 2
    assert str(service.process.pid) in second.stderr
    assert "Traceback" not in second.stderr


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_no_acknowledged_outcome_is_lost(number: int, tmp_path: Path) -> None:
    """Stopped, and killed, while outcomes come in."""
    log = tmp_path / "attempts.log"
    with running([*SERVE, "--log", str(log)], tmp_path) as service:
        acknowledged: dict[str, bool] = {}

        def report(i: int) -> None:
            n = 0
            with httpx.Client(base_url=service.url, timeout=60) as client:
                try:
                    while True:
                        told = client.post("/frames", json=scene(0.001 * i)).json()
                        name, n = told["decisions"][0]["id"], n + 1
                        given = {"decision_id": name, "success": n % 2 == 0}
                        if client.post("/outcomes", json=given).status_code == 200:
                            acknowledged[name] = given["success"]
                except (httpx.HTTPError, KeyError):
                    return

        threads = [threading.Thread(target=report, args=(i,)) for i in range(4)]
        for thread in threads:
            thread.start()
        until = time.monotonic() + 60
        while len(acknowledged) < 20 and time.monotonic() < until:
            time.sleep(0.02)
        service.process.send_signal(number)
        for thread in threads:
            thread.join()
        assert service.process.wait(timeout=30) == (0 if number == signal.SIGTERM else -number)
    with AttemptLog.read(log) as reader:
        table = reader.outcomes()
    recorded = dict(zip(table["decision_id"], table["success"], strict=True))
    assert len(acknowledged) >= 20
    assert {name: recorded.get(name) for name in acknowledged} == acknowledged


@pytest.mark.slow
def test_requests_are_logged_as_json_lines(service: Process, client: httpx.Client) -> None:
    client.post("/frames", json=scene(0.0))
    lines = [line for line in service.log() if line["event"] == "request"]
    assert {"method", "route", "status", "ms"} <= set(lines[-1])
    assert "ycbv" not in json.dumps(lines)


def mutated(body: bytes, rng: random.Random) -> bytes:
    """Return a body with a few bytes, numbers or parts changed, lost or doubled."""
    for _ in range(rng.choice((1, 1, 2, 5))):
        at, length = rng.randrange(len(body)), rng.choice((1, 1, 2, 8, 40))
        put = rng.choice(
            (
                b"", bytes([rng.randrange(256)]), 2 * body[at : at + length], b"null", b"1e308",
                b"-1e308", b"NaN", b"9" * 30, b"[]", b"{}", b'""', b"\\ud800", b",", b"0",
            )
        )  # fmt: skip
        body = body[:at] + put + body[at + length :]
    return body


@pytest.mark.slow
def test_mutated_bodies_are_never_a_fault(client: httpx.Client) -> None:
    rng = random.Random(7)
    camera = {"world_T_cam": moved(0, 0), "K": [[600, 0, 320], [0, 600, 240], [0, 0, 1]]}
    whole = json.dumps(scene(0.01, **camera, reachable={"ycbv-5": ["reference"]})).encode()
    outcome = json.dumps({"decision_id": "a", "success": True, "reason": "b"}).encode()
    episode = client.post("/frames", content=whole, headers=JSON).json()["episode"]
    seen = set()
    for _ in range(100):
        path, body = rng.choice(
            (("/frames", whole), (f"/episodes/{episode}/looks", whole), ("/outcomes", outcome))
        )
        response = client.post(path, content=mutated(body, rng), headers=JSON)
        assert response.status_code < 500, response.text
        seen.add(response.status_code)
    assert {200, 400, 422} <= seen
