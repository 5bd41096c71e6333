"""Pictures of trials: what is on them, that drawing changes nothing, what is said of it."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from PIL import Image

from graspcast.cli import main
from graspcast.errors import ExtraMissingError
from graspcast.pose.transforms import transform
from graspcast.rendering.trials.appearance import Appearance
from graspcast.rendering.trials.film import save_film, save_strip, strip_states
from graspcast.rendering.trials.renderer import SceneRenderer
from graspcast.rendering.trials.viewer import replay
from graspcast.simulation.grasps.table import ReferenceGrasp, write_grasps
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.recording import Recording, record_trial
from graspcast.simulation.trial.trial import TrialRunner
from solids import IDENTITY, box, from_above

SOURCE = Path(__file__).parents[3] / "src"
SIZE = 96
MISS = transform(np.eye(3), np.array([0.2, 0.0, 0.0]))
OFF = transform(np.eye(3), np.array([0.0, 0.015, 0.0]))

OBJECTS = """
[objects.cube]
label = "wooden cube"
mesh = "cube.ply"
unit = "mm"
mass_kg = 0.1
mass_source = "a test's"
friction = 0.8
friction_source = "a test's"
up = [0, 0, 1]
collision = { pieces = 1 }
"""


@pytest.fixture(scope="module")
def runner() -> TrialRunner:
    return TrialRunner(box(), load_gripper("parallel"))


@pytest.fixture(scope="module")
def grasp() -> Grasp:
    return Grasp(from_above(box(), 0.015), "box", "parallel")


@pytest.fixture(scope="module")
def held(runner: TrialRunner, grasp: Grasp) -> Recording:
    return record_trial(runner, OFF, grasp)


@pytest.fixture(scope="module")
def missed(runner: TrialRunner, grasp: Grasp) -> Recording:
    return record_trial(runner, MISS, grasp, early_stop=False)


@pytest.fixture(scope="module")
def renderer(runner: TrialRunner) -> Iterator[SceneRenderer]:
    with SceneRenderer(runner.grasp_object, runner.gripper, width=SIZE, height=SIZE) as drawing:
        yield drawing


@pytest.fixture
def tables(tmp_path: Path) -> list[str]:
    """Options for a cube of one's own with a grasp by one of the two hands."""
    import trimesh

    trimesh.creation.box(extents=(60, 60, 60)).export(tmp_path / "cube.ply")
    (tmp_path / "objects.toml").write_text(OBJECTS, encoding="utf-8")
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.015
    write_grasps(
        tmp_path / "grasps.toml", [ReferenceGrasp(Grasp(pose, "cube", "parallel"), "by a test")]
    )
    return [
        *("--catalogue", str(tmp_path / "objects.toml")),
        *("--grasps", str(tmp_path / "grasps.toml")),
    ]


def green(pixels: np.ndarray) -> int:
    """How many pixels are clearly green."""
    red, mid, blue = np.moveaxis(pixels.astype(int), -1, 0)
    return int(((mid > red + 25) & (mid > blue + 25)).sum())


def orange(pixels: np.ndarray) -> int:
    red, mid, blue = np.moveaxis(pixels.astype(int), -1, 0)
    return int(((red > mid + 25) & (mid > blue + 25)).sum())


@pytest.mark.parametrize("obj_T_est", [IDENTITY, OFF, MISS], ids=["perfect", "off", "far"])
@pytest.mark.parametrize("early_stop", [True, False])
def test_recording_does_not_change_the_outcome(
    runner: TrialRunner, grasp: Grasp, obj_T_est: np.ndarray, early_stop: bool
) -> None:
    plain = runner.run(obj_T_est, grasp, early_stop=early_stop)
    seen = record_trial(runner, obj_T_est, grasp, early_stop=early_stop).outcome
    assert repr(replace(plain, computed_s=0.0)) == repr(replace(seen, computed_s=0.0))


def test_a_recording_runs_forward_in_time_and_in_space(held: Recording) -> None:
    times = np.array([state.time_s for state in held.states])
    assert (np.diff(times) > 0).all() and np.diff(times).max() < 0.05
    approach = held.of("approach")
    heights = np.array([state.sim_T_base[2, 3] for state in approach])
    assert (np.diff(heights) < 1e-6).all()
    assert heights[0] - heights[-1] == pytest.approx(0.1, abs=1e-3)
    speeds = np.diff(heights) / np.diff(times[: len(approach)])
    assert speeds[:-10] == pytest.approx(-0.1, abs=0.02)
    film = held.every(0.1)
    assert film[0] is held.states[0] and film[-1] is held.states[-1]
    assert len(film) == pytest.approx(times[-1] / 0.1 + 1, abs=1)


def test_what_is_seen_is_where_the_trial_had_it(runner: TrialRunner, held: Recording) -> None:
    seen, state = Appearance(runner.grasp_object, runner.gripper), held.of("close")[-1]
    seen.pose(state)
    scene = runner.scene
    scene.data.qpos[scene.object_qpos] = seen.data.body("object").xpos.tolist() + [1, 0, 0, 0]
    box_middle = seen.data.body("object").xpos
    np.testing.assert_allclose(box_middle, state.sim_T_obj[:3, 3], atol=1e-9)
    pads = [seen.data.geom(f"hand/{side}_pad").xpos for side in ("left", "right")]
    gap = np.linalg.norm(pads[0] - pads[1]) - 2 * 0.00475
    # A cube of 60 mm between the pads, which give way by little.
    assert gap == pytest.approx(0.06, abs=1e-3)
    np.testing.assert_allclose(np.mean(pads, axis=0)[0], box_middle[0], atol=2e-3)


def test_the_estimate_is_drawn_where_it_differs_and_until_the_lift(
    runner: TrialRunner, grasp: Grasp, held: Recording
) -> None:
    assert held.overlay(held.of("close")[-1]) is held.sim_T_est
    assert held.overlay(held.of("lift")[-1]) is None
    perfect = record_trial(runner, IDENTITY, grasp)
    assert perfect.overlay(perfect.states[0]) is None


def test_a_strip_shows_the_moments_and_tells_held_from_missed(
    tmp_path: Path, renderer: SceneRenderer, held: Recording, missed: Recording
) -> None:
    strips = []
    for name, recording in (("held", held), ("missed", missed)):
        path = tmp_path / f"{name}.png"
        save_strip(path, recording, renderer, name)
        with Image.open(path) as image:
            pixels = np.asarray(image.convert("RGB"))
        count = len(strip_states(recording))
        assert pixels.shape[1] == count * SIZE and SIZE < pixels.shape[0] < 2 * SIZE
        panels = pixels[52 : 52 + SIZE].reshape(SIZE, count, SIZE, 3).swapaxes(0, 1)
        assert all(panel.std() > 3 for panel in panels)
        assert green(panels[0]) > 20 and green(panels[-1]) == 0
        assert orange(panels[0]) > 20
        strips.append(panels)
    assert [name for name, _ in strip_states(missed)][:3] == ["pre-grasp", "at the grasp", "closed"]
    # Held, the cube fills the last picture; missed, it lies 1.5 m below the hand.
    assert orange(strips[0][-1]) > 10 * orange(strips[1][-1])


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".gif", ".mp4"])
def test_a_film_can_be_read_and_moves(
    tmp_path: Path, renderer: SceneRenderer, held: Recording, ending: str
) -> None:
    path = tmp_path / f"film{ending}"
    shares: list[float] = []
    if ending == ".mp4":
        imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="no encoder (extra video)")
    save_film(path, held, renderer, "a cube", progress=shares.append)
    assert shares[-1] == 1.0 and shares == sorted(shares)
    if ending == ".gif":
        with Image.open(path) as image:
            frames = []
            for k in range(image.n_frames):
                image.seek(k)
                frames.append(np.asarray(image.convert("RGB")))
    else:
        read = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path)]
        raw = subprocess.run(
            [*read, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], capture_output=True, check=True
        ).stdout
        frames = list(np.frombuffer(raw, np.uint8).reshape(-1, SIZE, SIZE, 3))
    seconds = held.states[-1].time_s
    assert len(frames) >= 10 * seconds
    assert np.abs(frames[0].astype(int) - frames[-1]).mean() > 2
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_the_contact_sheet_has_a_field_for_each_pair(
    tmp_path: Path, tables: list[str], renderer: SceneRenderer, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "sheet.png"
    command = ["grasps", *tables, "--objects", "cube", "lmo-5", "--size", "100", "--out", str(out)]
    assert main(command) == 0
    said = capsys.readouterr().out
    for line in ("cube by parallel", "cube by underactuated", "lmo-5 by parallel"):
        assert line in said
    assert "held" in said and said.count("no reference grasp") + said.count("no mesh") == 3
    with Image.open(out) as image:
        pixels = np.asarray(image.convert("RGB"))
    left, right = np.array_split(pixels[:, 40:], 2, axis=1)
    (top, below), (other, _) = (np.array_split(part, 2, axis=0) for part in (left, right))
    assert orange(top) > 200
    assert orange(below) == orange(other) == 0


def test_watch_says_the_outcome_and_draws_it(
    tmp_path: Path, tables: list[str], renderer: SceneRenderer, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "watch.png"
    trial = ["watch", "--object", "cube", "--gripper", "parallel", *tables, "--size", "64x64"]
    assert main([*trial, "--out", str(out)]) == 0
    assert "wooden cube" in (said := capsys.readouterr().out) and "held" in said
    assert main([*trial, "--out", str(out), "--offset", "600", "0", "0", "0", "0", "30"]) == 0
    heard = capsys.readouterr()
    assert "missed" in heard.out and "--full" in heard.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--out", "film.avi"], [".mp4, .gif, .png"]),
        (["--gripper", "underactuated", "--out", "a.png"], ["unknown grasp", "parallel"]),
        (["--object", "cub", "--out", "a.png"], ["did you mean 'cube'"]),
        (["--image", "2/3", "--out", "a.png"], ["--estimates"]),
        (["--offset", *"00000", "nan", "--out", "a.png"], ["finite"]),
        (["--offset", "1e9", *"00000", "--out", "a.png"], ["1e+06 m off"]),
        (["--estimates", "a=b.csv", "--out", "a.png"], ["--bop", "--image"]),
        (["--estimates", "a=b", "--offset", *"000000", "--out", "a.png"], ["give one"]),
    ],
)
def test_what_watch_cannot_do_is_said(
    tables: list[str],
    options: list[str],
    words: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    trial = ["watch", "--object", "cube", "--gripper", "parallel", *tables]
    assert main([*trial, *options]) == 2
    said = capsys.readouterr().err
    assert all(word in said for word in words), said


@pytest.mark.slow
def test_a_published_estimate_is_watched(
    data_dir: Path, tmp_path: Path, renderer: SceneRenderer, capsys: pytest.CaptureFixture[str]
) -> None:
    published, bop = data_dir / "published" / "ycbv", data_dir / "bop" / "ycbv"
    with (published / "epos_ycbv-test.csv").open() as stream:
        row = next(line for line in stream if line.split(",")[2] == "4")
    scene_id, im_id, *_ = row.split(",")
    trial = [
        *("watch", "--object", "ycbv-4", "--gripper", "parallel", "--bop", str(bop)),
        *("--ground-truth", str(published / "ground_truth")),
        *("--estimates", f"epos={published / 'epos_ycbv-test.csv'}", "--size", "64x64"),
        *("--out", str(tmp_path / "strip.png")),
    ]
    assert main([*trial, "--image", f"{scene_id}/{im_id}"]) == 0
    assert (tmp_path / "strip.png").stat().st_size > 1000
    capsys.readouterr()
    assert main([*trial, "--image", "999/1"]) == 2
    assert "no estimate of ycbv-4 in image 999/1" in capsys.readouterr().err
    assert main([*trial, "--image", f"{scene_id}/{im_id}", "--instance", "7"]) == 2
    assert "--instance 7" in capsys.readouterr().err


def watch_elsewhere(
    out: Path, tables: list[str], environment: dict[str, str], *before: str
) -> subprocess.CompletedProcess[str]:
    """Draw a strip in a process of its own, perhaps after some lines of Python."""
    command = ["watch", "--object", "cube", "--gripper", "parallel", *tables, "--out", str(out)]
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("MUJOCO", "PYOPENGL"))}
    lines = ["import sys", *before, "from graspcast.cli import main", f"sys.exit(main({command}))"]
    return subprocess.run(
        [sys.executable, "-c", "\n".join(lines)],
        capture_output=True,
        text=True,
        env=clean | {"PYTHONPATH": str(SOURCE)} | environment,
        check=False,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({"MUJOCO_GL": "disable"}, ["MUJOCO_GL is 'disable'"]),
        # A device that is not there is a real EGL that does not work.
        ({"MUJOCO_EGL_DEVICE_ID": "99"}, ["EGL", "OSMesa", "libegl1"]),
        # PyOpenGL is told to look elsewhere than OSMesa: the same as a library that is not there.
        ({"MUJOCO_GL": "osmesa", "PYOPENGL_PLATFORM": "egl"}, ["OSMESA", "libosmesa6", "=egl"]),
    ],
)
@pytest.mark.skipif(sys.platform != "linux", reason="EGL and OSMesa are Linux's")
def test_without_opengl_it_is_drawn_in_software_and_said_why(
    tmp_path: Path, tables: list[str], environment: dict[str, str], words: list[str]
) -> None:
    if environment != {"MUJOCO_GL": "disable"}:
        pytest.importorskip("OpenGL", reason="pyopengl is not installed (extra render)")
    done = watch_elsewhere(tmp_path / "a.png", tables, environment)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("drawn in software") == 1
    assert all(word in done.stderr for word in words), done.stderr
    with Image.open(tmp_path / "a.png") as image:
        assert orange(np.asarray(image)) > 1000


@pytest.mark.slow
def test_without_pyopengl_it_is_drawn_in_software(tmp_path: Path, tables: list[str]) -> None:
    without = "sys.modules.update(OpenGL=None, glfw=None)"
    done = watch_elsewhere(tmp_path / "a.png", tables, {}, without)
    assert done.returncode == 0, done.stderr
    assert "drawn in software" in done.stderr and "graspcast[render]" in done.stderr
    with Image.open(tmp_path / "a.png") as image:
        assert orange(np.asarray(image)) > 1000


@pytest.mark.skipif(sys.platform != "linux", reason="EGL and OSMesa are Linux's")
def test_a_backend_that_nobody_knows_is_refused(tmp_path: Path, tables: list[str]) -> None:
    done = watch_elsewhere(tmp_path / "a.png", tables, {"MUJOCO_GL": "vulkan"})
    assert done.returncode == 2, done.stderr
    for word in ("MUJOCO_GL", "'vulkan'", "egl, osmesa"):
        assert word in done.stderr
    assert "Traceback" not in done.stderr and not list(tmp_path.glob("*.png"))


def test_without_a_display_there_is_no_viewer(
    tables: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("platform.system", lambda: "Linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["watch", "--object", "cube", "--gripper", "parallel", *tables]) == 2
    assert "no display" in (said := capsys.readouterr().err) and ".mp4, .gif or .png" in said


def test_a_missing_extra_is_named_and_leaves_nothing_behind(
    tmp_path: Path, renderer: SceneRenderer, held: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ExtraMissingError, match=r"imageio-ffmpeg.*graspcast\[video\]"):
        save_film(tmp_path / "film.mp4", held, renderer, "a cube")
    assert not list(tmp_path.iterdir())


def test_a_closed_renderer_draws_no_more(runner: TrialRunner, held: Recording) -> None:
    drawing = SceneRenderer(runner.grasp_object, runner.gripper, width=64, height=64)
    view = drawing.close_up(held.states[0])
    drawing.close()
    drawing.close()
    with pytest.raises(ValueError, match="closed"):
        drawing.image(held.states[0], view)


class _Window:
    """Stands where MuJoCo's viewer needs a display, and is closed after some pictures."""

    def __init__(self, model: object, data: mujoco.MjData):
        self.data, self.heights = data, []
        self.cam = mujoco.MjvCamera()

    def __enter__(self) -> _Window:
        return self

    def __exit__(self, *_: object) -> None:
        self.closed = True

    def lock(self) -> contextlib.AbstractContextManager[None]:
        return contextlib.nullcontext()

    def is_running(self) -> bool:
        return len(self.heights) < 20

    def sync(self) -> None:
        self.heights.append(float(self.data.body("hand").xpos[2]))


def test_the_viewer_plays_the_recording(
    runner: TrialRunner, held: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    windows: list[_Window] = []

    def launch_passive(model: object, data: mujoco.MjData, **_: object) -> _Window:
        windows.append(_Window(model, data))
        return windows[0]

    monkeypatch.setitem(
        sys.modules, "mujoco.viewer", SimpleNamespace(launch_passive=launch_passive)
    )
    monkeypatch.setattr(mujoco, "viewer", sys.modules["mujoco.viewer"], raising=False)
    replay(held, runner.grasp_object, runner.gripper)
    heights = windows[0].heights
    assert windows[0].closed and len(heights) == 20
    assert (np.diff(heights) < 0).all()  # the approach, from above
