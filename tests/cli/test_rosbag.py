"""The verb rosbag, on bags that are written here."""

from __future__ import annotations

from pathlib import Path

import pytest

import ros_bags as bags
import ros_messages as ros
from commands import refused
from episode_world import FOUND, NAMES, new_world
from graspcast.cli import main

pytest.importorskip("rosbags", reason="pip install 'graspcast[rosbag]'")


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with a model and a bag of two images, the second by one estimator less."""
    folder = tmp_path_factory.mktemp("rosbag")
    new_world(folder).forecaster.save(folder / "model.npz")
    with bags.Bag(folder / "in", "mcap") as bag:
        for image, names in enumerate((NAMES, NAMES[:-1])):
            for name in names:
                found = [ros.detection("mug", FOUND[name][image, 0])]
                found.append(ros.detection("box", FOUND[name][image, 1]))
                time_s = bags.START_S + image
                bag.detect(f"/{name}", ros.detections(time_s, *found), time_s)
    return folder


def command(given: Path, out: Path, *more: str) -> list[str]:
    estimates = [text for name in NAMES for text in ("--estimates", f"{name}=/{name}")]
    known = ["--model", str(given / "model.npz"), "--objects", "mug=d-1", "--threshold", "0.7"]
    frames = ["--camera-frame", ros.CAMERA]
    return ["rosbag", str(given / "in"), str(out), *known, *estimates, *frames, *more]


def test_what_was_done_and_what_was_left_out_is_said(
    given: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.db3"
    assert main(command(given, out, "--prefix", "/judged")) == 0
    said, notes = capsys.readouterr()
    assert f"{out} (SQLite): 5 messages copied; 2 frames, 2 judged; verdicts: " in said
    assert "estimate of an unknown class: 5 (first: 'box' by " in notes
    assert f"image without a message by {NAMES[-1]}: 1" in notes
    topics = [topic for topic, _, _ in bags.read_bag(out)]
    assert topics.count("/judged/verdicts") == topics.count("/judged/detections") == 2


def test_mistakes_are_one_message_with_the_option(
    given: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.mcap"
    for more, said in [
        (["--objects", "box"], "objects should be CLASS=OBJECT, not 'box' (see --objects)"),
        (["--objects", "box=d-77"], "unknown object 'd-77'"),
        (["--estimates", "sam=/sam"], "unknown estimator 'sam'"),
        (["--estimates", f"{NAMES[0]}=/x"], f"estimates has '{NAMES[0]}' twice (see --estimates)"),
        (
            ["--episodes", "static"],
            "name a frame that stands still (see --world-frame, --episodes)",
        ),
        (["--tolerance-s", "nan"], "tolerance_s should be between 0 and 3600"),
        (["--camera-frame", "/"], "not guessed from the detections (see --camera-frame)"),
        (["--guide", "sam"], "unknown guide 'sam'"),
    ]:
        assert said in refused(command(given, out, *more), capsys)
    wrong = command(given, out)
    wrong[wrong.index(f"{NAMES[0]}=/{NAMES[0]}")] = f"{NAMES[0]}=/nothing"
    told = refused(wrong, capsys)
    assert "unknown topic '/nothing'" in told and "/a (vision_msgs/msg/Detection3DArray)" in told
    assert "no such bag" in refused(
        ["rosbag", str(given / "absent"), *command(given, out)[2:]], capsys
    )
    assert list(tmp_path.iterdir()) == []
