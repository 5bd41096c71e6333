"""Strips and films of trials."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from cubes import SIZE, green, orange
from graspcast.errors import ExtraMissingError
from graspcast.pose.transforms import transform
from graspcast.rendering.trials.film import describe, save_film, save_strip, strip_states
from graspcast.rendering.trials.renderer import SceneRenderer
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.recording import Recording, record_trial
from graspcast.simulation.trial.trial import Outcome, TrialRunner


@pytest.mark.slow
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
    assert strip_states(missed)[-1][0].startswith("end, hand lifted ")
    # Held, the cube fills the last picture; missed, it lies 1.5 m below the hand.
    assert orange(strips[0][-1]) > 10 * orange(strips[1][-1])


@pytest.mark.slow
def test_a_strip_of_a_collision_ends_where_the_hand_stopped(
    tmp_path: Path, runner: TrialRunner, grasp: Grasp, renderer: SceneRenderer
) -> None:
    deep = transform(np.eye(3), np.array([0.0, 0.0, -0.06]))
    collided = record_trial(runner, deep, grasp)
    assert [name for name, _ in strip_states(collided)] == ["pre-grasp", "stopped"]
    words = describe(collided.outcome)
    assert re.fullmatch(r"collided, stopped \d+ mm short, pressing the object with \d+ N", words)
    stopped = collided.states[-1].sim_T_base[2, 3] - collided.states[0].sim_T_base[2, 3]
    assert -stopped == pytest.approx(
        runner.settings.standoff_m - collided.outcome.short_m, abs=2e-3
    )
    save_strip(tmp_path / "strip.png", collided, renderer, "too deep")
    with Image.open(tmp_path / "strip.png") as image:
        assert image.width == 2 * SIZE


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".gif", ".mp4"])
def test_a_film_can_be_read_and_moves(
    tmp_path: Path, renderer: SceneRenderer, held: Recording, ending: str
) -> None:
    path = tmp_path / f"film{ending}"
    shares: list[float] = []
    if ending == ".mp4":
        imageio_ffmpeg = pytest.importorskip(
            "imageio_ffmpeg", reason="needs an encoder: pip install 'graspcast[video]'"
        )
    save_film(path, held, renderer, "a cube", progress=lambda share, _: shares.append(share))
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


def test_a_missing_extra_is_named_and_leaves_nothing_behind(
    tmp_path: Path, renderer: SceneRenderer, held: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ExtraMissingError, match=r"imageio-ffmpeg.*graspcast\[video\]"):
        save_film(tmp_path / "film.mp4", held, renderer, "a cube")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("reason", "offset_m", "says"),
    [
        ("held", 0.0032, "held, moved 3.2 mm in the hand"),
        ("slipped", 0.035, "slipped, moved 35 mm in the hand"),
        ("missed", 1.48, "missed, object 1.48 m behind after the full lift"),
        ("dropped", 1.5, "dropped, object 1.50 m behind after the full lift"),
        ("blocked", float("nan"), "blocked"),
    ],
)
def test_an_outcome_says_what_its_length_is(reason: Any, offset_m: float, says: str) -> None:
    assert describe(Outcome(reason == "held", reason, offset_m, 1.0, 1.0, 1)) == says
