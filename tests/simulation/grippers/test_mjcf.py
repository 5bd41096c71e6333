"""Loading of grippers: by name, and from MJCF with a TOML file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.pose.transforms import transform
from graspcast.simulation.grippers import (
    GRIPPERS,
    FrankaHand,
    TendonHand,
    load_gripper,
    load_grippers,
)
from graspcast.simulation.grippers.protocol import gripper_digest
from graspcast.simulation.trial.settings import TrialSettings
from jaws import write_jaws

THREE_JAW = Path(__file__).parents[2] / "data" / "three_jaw.toml"


def test_grippers_are_loaded_by_name_or_by_file() -> None:
    assert {name: type(load_gripper(name)) for name in GRIPPERS} == {
        "parallel": FrankaHand,
        "underactuated": TendonHand,
    }
    assert load_gripper(THREE_JAW).name == "three_jaw"
    with pytest.raises(UnknownNameError, match=r"'frank'.*did you mean 'franka'.*\.toml"):
        load_gripper("frank")


def test_the_tool_centre_point_of_a_foreign_hand_is_in_its_base_frame() -> None:
    # The site sits 55 mm along -y of the base; z of the site is -y, x is z of the base.
    expected = transform(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.array([0, -0.055, 0]))
    np.testing.assert_allclose(load_gripper(THREE_JAW).base_T_tcp, expected, atol=1e-9)


def test_a_gripper_may_set_the_limits_on_its_approach(tmp_path: Path) -> None:
    (tmp_path / "three_jaw.xml").write_text(MJCF)
    path = tmp_path / "hand.toml"
    path.write_text(TOML + "\n[approach]\nforce_n = 25.0\nshort_m = 0.003\n")
    careful = load_gripper(path)
    settings = TrialSettings.robot(careful)
    assert (settings.contact_force_n, settings.short_m) == (25.0, 0.003)
    # The arm's limits are of the settings, so the gripper's own digest is as without them.
    assert gripper_digest(careful) == gripper_digest(load_gripper(THREE_JAW))
    assert TrialSettings.robot(load_gripper(THREE_JAW)) == TrialSettings()


TOML = THREE_JAW.read_text()

MJCF = (THREE_JAW.parent / "three_jaw.xml").read_text()


@pytest.mark.ill_typed
@pytest.mark.parametrize(
    ("toml", "mjcf", "error", "message"),
    [
        (("a = 0.0,", "drive = 0.0,"), None, FormatError, "both must name the same ones"),
        (
            ("", ""),
            ('<position name="a"', '<position name="x"'),
            UnknownNameError,
            "known: x, b, c",
        ),
        (
            ("", ""),
            ("</actuator>", '<motor name="d" joint="a"/></actuator>'),
            FormatError,
            "actuators d of",
        ),
        (('"grasp"', '"tcp"'), None, UnknownNameError, r"unknown site 'tcp'.*known: grasp"),
        (('"three_jaw.xml"', '"hand.xml"'), None, InputError, "no such file"),
        (("name =", "nome ="), None, FormatError, "name is missing"),
        (("name =", "nome = 1\nname ="), None, FormatError, r"unknown key 'nome'.*'name'"),
        (("max_opening_m = 0.09\n", ""), None, FormatError, "max_opening_m is missing"),
        (("0.09", "-1"), None, FormatError, "max_opening_m is -1.0.*above zero"),
        (("0.09", "90"), None, FormatError, r"is 90 m, but the hand is .* in millimetres \(90 mm"),
        (("0.09", "9"), None, FormatError, "is 9.00 m, but the hand is .*in centimetres"),
        (('"three_jaw"', '"parallel"'), None, FormatError, "that of a built-in gripper"),
        (('"three_jaw"', '"franka"'), None, FormatError, "that of a built-in gripper"),
        (('"three_jaw"', '" "'), None, FormatError, "name is empty"),
        (
            ("a = 0.06", "a = 60"),
            ('<position name="a"', '<position name="a" ctrlrange="0 0.06"'),
            FormatError,
            "close sets a to 60, outside of its ctrlrange 0 to 0.06",
        ),
        (("a = 0.06", "a = nan"), None, FormatError, "a is nan, and must be finite"),
        (("a = 0.06", "a = 'far'"), None, FormatError, "a should be a number, not 'far'"),
        (("seconds = 0.6", "seconds = 'x'"), None, FormatError, "seconds should be a number"),
        (("[closing]", "[equilibrium]\nlimit_s = []\n[closing]"), None, FormatError, "limit_s sho"),
        (("", ""), ('name="a" ', ""), FormatError, "1 of its 3 actuators have no name"),
        (("seconds = 0.6", "seconds = 0"), None, FormatError, "closing takes 0 s"),
        (("seconds = 0.6", "second = 0.6"), None, FormatError, r"\[closing\].*it may hold open"),
        (("[closing]", "[closing"), None, FormatError, "is not TOML"),
        (("[closing]", "[approach]\nforce_n = 0\n[closing]"), None, FormatError, "force_n is 0"),
        (("[closing]", "[approach]\nforce_n = 'x'\n[closing]"), None, FormatError, "a number"),
        (("[closing]", "[approach]\nshort_m = 5\n[closing]"), None, FormatError, "millimetres"),
        (("[closing]", "[approach]\nnewtons = 5\n[closing]"), None, FormatError, "force_n, sho"),
        (("[closing]", "[equilibrium]\nlimit = 1\n[closing]"), None, FormatError, "equilibrium"),
        (
            ("", ""),
            ('<body name="chuck"', '<body name="x"/><body name="chuck"'),
            FormatError,
            "one",
        ),
        (("", ""), ("<light", "<freejoint/><light"), FormatError, "not MJCF"),
        (("", ""), ('joint="b" kp', 'joint="z" kp'), FormatError, "does not compile"),
    ],
)
def test_a_wrong_description_is_explained(
    toml: tuple[str, str],
    mjcf: tuple[str, str] | None,
    error: type[Exception],
    message: str,
    tmp_path: Path,
) -> None:
    assert toml[0] in TOML
    (tmp_path / "three_jaw.toml").write_text(TOML.replace(*toml, 1))
    old, new = mjcf or ("", "")
    assert old in MJCF
    (tmp_path / "three_jaw.xml").write_text(MJCF.replace(old, new, 1))
    with pytest.raises(error, match=message):
        load_gripper(tmp_path / "three_jaw.toml")


def test_a_hand_without_collision_geometry_is_refused(tmp_path: Path) -> None:
    path = write_jaws(tmp_path)
    mjcf = (tmp_path / "jaws.xml").read_text()
    (tmp_path / "jaws.xml").write_text(mjcf.replace("<geom ", '<geom contype="0" conaffinity="0" '))
    with pytest.raises(FormatError, match=r"jaws.xml.*no geom of the hand collides \(3 are there"):
        load_gripper(path)


def test_two_grippers_of_one_name_are_refused(tmp_path: Path) -> None:
    assert list(load_grippers(["parallel", THREE_JAW])) == ["parallel", "three_jaw"]
    with pytest.raises(InputError, match="two grippers are called 'parallel': parallel and franka"):
        load_grippers(["parallel", "franka"])
    with pytest.raises(InputError, match="two grippers are called 'three_jaw'"):
        load_grippers([THREE_JAW, THREE_JAW])


def test_an_mjcf_that_is_not_text(tmp_path: Path) -> None:
    (tmp_path / "three_jaw.toml").write_text(TOML)
    (tmp_path / "three_jaw.xml").write_bytes(MJCF.replace("grasp", "\xff").encode("latin-1"))
    with pytest.raises(InputError, match=r"three_jaw"):
        load_gripper(tmp_path / "three_jaw.toml")
