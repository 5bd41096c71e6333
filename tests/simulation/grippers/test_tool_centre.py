"""The tool centre point: a site, or a pose."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from graspcast.errors import FormatError, UnknownNameError
from graspcast.pose.transforms import transform
from graspcast.simulation.grippers import load_gripper
from jaws import write_jaws

TURNED = transform(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([0.01, 0.02, 0.03]))
POSE = "tcp_position_m = [0.01, 0.02, 0.03]\ntcp_quaternion = [0.70710678, 0, 0, 0.70710678]"


def tcp(tmp_path: Path, text: str) -> np.ndarray:
    base_T_tcp: np.ndarray = load_gripper(write_jaws(tmp_path, tcp=text)).base_T_tcp
    return base_T_tcp


def test_a_pose_in_the_frame_of_the_base(tmp_path: Path) -> None:
    np.testing.assert_allclose(tcp(tmp_path, POSE), TURNED, atol=1e-8)


def test_a_pose_in_the_frame_of_the_base_wherever_the_base_is(tmp_path: Path) -> None:
    path = write_jaws(tmp_path, tcp=POSE)
    mjcf = (tmp_path / "jaws.xml").read_text()
    moved = mjcf.replace('<body name="hand">', '<body name="hand" pos="1 2 3" quat="0 1 0 0">')
    (tmp_path / "jaws.xml").write_text(moved)
    np.testing.assert_allclose(load_gripper(path).base_T_tcp, TURNED, atol=1e-8)


def test_a_pose_in_the_frame_of_a_body_and_that_of_the_body(tmp_path: Path) -> None:
    path = write_jaws(tmp_path, tcp=POSE + '\ntcp_body = "flange"')
    flange = '<body name="flange" pos="0 0 0.1"/><body name="l"'
    mjcf = (tmp_path / "jaws.xml").read_text().replace('<body name="l"', flange)
    (tmp_path / "jaws.xml").write_text(mjcf)
    raised = np.eye(4)
    raised[2, 3] = 0.1
    np.testing.assert_allclose(load_gripper(path).base_T_tcp, raised @ TURNED, atol=1e-8)
    path.write_text(path.read_text().replace(POSE, ""))
    np.testing.assert_allclose(load_gripper(path).base_T_tcp, raised, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"needs either tcp_site, or tcp_position_m and tcp_quaternion.*it has neither"),
        (POSE + '\ntcp_site = "tcp"', "it has .*tcp_site"),
        ("tcp_position_m = [0, 0, 0.05]", "tcp_quaternion is missing"),
        (POSE.replace("0.02, 0.03]", "0.02]"), "tcp_position_m should be 3 finite numbers"),
        (POSE.replace("0.7", "1.7"), "tcp_quaternion has length 2.* not 1"),
        (POSE.replace("0.03]", "50.0]"), r"is 50 m, but the hand is .*in millimetres \(50 mm\)"),
        ('tcp_body = "l"', "tcp_body is 'l', which moves as the hand closes"),
    ],
)
def test_a_wrong_one_is_explained(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=message):
        tcp(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('tcp_site = "tip"', "unknown site 'tip'.*known: tcp.*a pose in the TOML"),
        ('tcp_body = "tip"', "unknown body 'tip'.*known: hand, l, r"),
    ],
)
def test_an_unknown_one(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match=message):
        tcp(tmp_path, text)


def test_a_site_in_millimetres(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"is 50 m, .*in millimetres \(50 mm\).*see tcp_site"):
        load_gripper(write_jaws(tmp_path, z=50))
