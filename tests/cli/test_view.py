"""The verb view."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from commands import refused
from cubes import write_tables
from graspcast.bop.results import read_results
from graspcast.cli import main
from graspcast.forecasting.verdict_file import write_verdicts
from graspcast.simulation.grasps.table import ReferenceGrasp, write_grasps
from graspcast.simulation.objects.types import Grasp
from overlays import verdict_row, write_estimates


@pytest.fixture
def seen(tmp_path: Path) -> Path:
    """Estimates by a and b, verdicts on two of a's, and a grasp of each object."""
    write_estimates(tmp_path)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.015
    grasps = [ReferenceGrasp(Grasp(pose, f"made-{k}", "parallel"), "a test") for k in (1, 5)]
    write_grasps(tmp_path / "grasps.toml", grasps)
    table = read_results(tmp_path / "a_made-test.csv")
    rows = [
        verdict_row(1, 3, int(table.obj_id[i]), probability=p, cam_T_obj=table.cam_T_obj[i])
        for i, p in ((0, 0.875), (1, 0.25))
    ]
    write_verdicts(tmp_path / "verdicts.csv", rows)
    return tmp_path


def view(seen: Path, *more: str) -> list[str]:
    files = [t for n in "ab" for t in ("--estimates", f"{n}={seen / f'{n}_made-test.csv'}")]
    return ["view", "--bop", str(seen / "made"), *files, *more]


def names_in(path: Path) -> set[str]:
    import trimesh

    return set(trimesh.load_scene(path).graph.nodes_geometry)


def test_a_scene_is_written_without_the_extra(
    seen: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    out = seen / "scene.glb"
    more = ["--verdicts", str(seen / "verdicts.csv"), "--grasps", str(seen / "grasps.toml")]
    assert main(view(seen, "--image", "1/3", *more, "--out", str(out))) == 0
    assert f"{out}: image 1/3 of made, 9 nodes" in capsys.readouterr().out
    assert names_in(out) == {
        *("camera", "truth/made-1 gt 0", "truth/made-5 gt 1"),
        *(f"estimates/{e}/made-{o} est 0" for e in "ab" for o in (1, 5)),
        "grasps/made-1 est 0 by a/parallel reference P 0.88",
        "grasps/made-5 est 0 by a/parallel reference P 0.25",
    }


def test_the_truth_alone_and_some_objects(seen: Path) -> None:
    out = seen / "scene.glb"
    command = ["view", "--bop", str(seen / "made"), "--image", "2/3", "--out", str(out)]
    assert main([*command, "--objects", "5"]) == 0
    assert names_in(out) == {"camera", "truth/made-5 gt 1"}


def test_fused_poses_have_ellipsoids(seen: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fuse = view(seen)
    fuse[0] = "fuse"
    fused, table = seen / "fused_made-test.csv", seen / "cov.csv"
    assert main([*fuse, "--max-views", "1", "--out", str(fused), "--covariances", str(table)]) == 0
    out = seen / "scene.glb"
    more = ["--fused", str(fused), "--covariances", str(table), "--objects", "made-1"]
    assert main(view(seen, "--image", "1/3", *more, "--out", str(out))) == 0
    assert {"fused/made-1 est 0", "ellipsoids/made-1 est 0"} < names_in(out)
    table.write_text("\n".join(table.read_text().splitlines()[:1] + ["ycbv" + ",1" * 60]) + "\n")
    assert "cov.csv" in refused(view(seen, "--image", "1/3", *more, "--out", str(out)), capsys)


def test_a_trial_is_written_as_an_animation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "trial.glb"
    trial = ["view", "--object", "cube", "--gripper", "parallel", *write_tables(tmp_path)]
    assert main([*trial, "--offset", *["0", "9", "0", "0", "0", "0"], "--out", str(out)]) == 0
    assert "wooden cube (cube), parallel gripper: held" in capsys.readouterr().out
    assert b'"animations":[{"name":"trial"' in out.read_bytes()
    assert {"object", "estimate", "table", "hand/left_finger"} < names_in(out)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ([], ["--image", "--object"]),
        (["--image", "9/9"], ["9/9", "made", "--image"]),
        (["--image", "1/3", "--offset", *"000000"], ["--offset is of a trial"]),
        (["--image", "1/3", "--full"], ["--full is of a trial"]),
        (["--image", "1/3", "--covariances", "c.csv"], ["--fused"]),
        (["--image", "1/3", "--ranked-grasps", "c.csv"], ["--verdicts"]),
        (["--image", "1/3", "--objects", "7"], ["object 7", "--objects"]),
        (["--image", "1/3", "--verdicts", "nowhere.csv"], ["nowhere.csv"]),
        (["--image", "1/3", "--verdicts", "{seen}/verdicts.csv"], ["made-1", "parallel"]),
        (["--image", "1/3", "--fused", "{seen}/a_made-test.csv"], ["the same poses", "fused"]),
        (["--image", "1/3", "--estimates", "fused={seen}/a_made-test.csv"]
         + ["--fused", "{seen}/b_made-test.csv"], ["called fused"]),
        (["--object", "cube", "--verdicts", "v.csv"], ["--verdicts is of a scene"]),
        (["--object", "cube"], ["--gripper"]),
        (["--image", "1/3", "--out", "scene.obj"], [".glb"]),
    ],
)  # fmt: skip
def test_what_cannot_be_viewed_is_said(
    seen: Path, more: list[str], words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    given = [text.format(seen=seen) for text in more]
    out = [] if "--out" in given else ["--out", str(seen / "s.glb")]
    said = refused(view(seen, *given, *out), capsys)
    assert all(word in said for word in words), said
    assert not (seen / "s.glb").exists()


def test_without_models_the_option_is_named(seen: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["view", "--estimates", f"a={seen / 'a_made-test.csv'}", "--image", "1/3"]
    assert "--bop" in refused([*command, "--out", "s.glb"], capsys)


def test_without_viser_the_pip_line_is_named_at_once(
    seen: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    said = refused(view(seen, "--image", "1/3"), capsys)
    assert "pip install 'graspcast[view]'" in said


@pytest.mark.parametrize("port", ["-1", "65536", "http", "1.5"])
def test_a_port_is_a_number(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["view", "--port", port])
    assert "a port from 0 to 65535" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="processes have no signals there")
@pytest.mark.parametrize(
    "ending", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_a_process_serves_until_it_is_ended(seen: Path, ending: int) -> None:
    pytest.importorskip("viser", reason="install it: pip install 'graspcast[view]'")
    paths = os.pathsep.join(filter(None, sys.path))
    with subprocess.Popen(
        [sys.executable, "-m", "graspcast", *view(seen, "--image", "1/3", "--port", "0")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": paths, "GRASPCAST_PROGRESS_S": "60"},
        # A test that runs in the background would hand on that it ignores Ctrl-C.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as process:
        assert process.stdout is not None
        line = process.stdout.readline().strip()
        assert line.startswith("image 1/3 of made: http://127.0.0.1:")
        with urllib.request.urlopen(line.split(": ")[1], timeout=20) as answer:
            assert answer.status == 200
        process.send_signal(ending)
        out, err = process.communicate(timeout=30)
    assert process.returncode == 0 and out == ""
    assert "Traceback" not in err and err.splitlines()[-1] == "ended"
