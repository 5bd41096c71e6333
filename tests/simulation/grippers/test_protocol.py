from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import trimesh

from graspcast.errors import InputError
from graspcast.simulation.grippers import GRIPPERS, FrankaHand, TendonHand, load_gripper
from graspcast.simulation.grippers.protocol import Closing, Equilibrium, Gripper, gripper_digest
from jaws import write_urdf_jaws

MESH = (
    '<collision><geometry><mesh filename="palm.stl" scale="0.001 0.001 0.001"/></geometry>'
    "</collision>"
)
THREE_JAW = Path(__file__).parents[2] / "data" / "three_jaw.toml"


def test_every_gripper_satisfies_the_protocol() -> None:
    for name in (*GRIPPERS, THREE_JAW):
        assert isinstance(load_gripper(name), Gripper)


def test_digests_follow_the_model_and_the_commands() -> None:
    hands = [
        FrankaHand(),
        FrankaHand(grip_n=50.0),
        FrankaHand(finger_speed=0.04),
        TendonHand(),
        TendonHand(pulleys_m=(0.010, 0.005)),
        load_gripper(THREE_JAW),
        replace(load_gripper(THREE_JAW), equilibrium=Equilibrium(limit_s=1.0)),
    ]
    assert len({gripper_digest(hand) for hand in hands}) == len(hands)
    assert gripper_digest(FrankaHand()) == gripper_digest(FrankaHand())


@pytest.mark.parametrize("seconds", [0.0, 1e9, float("nan")])
def test_a_closing_that_takes_no_time_or_for_ever(seconds: float) -> None:
    with pytest.raises(InputError, match="give a time above zero, at most 60 s"):
        Closing({"a": 0.0}, {"a": 1.0}, seconds)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"limit_s": 1e7}, "limit_s is 10000000.0; give at least window_s"),
        ({"window_s": 3.0}, "limit_s is 2.5; give at least window_s"),
        ({"window_s": float("inf")}, "window_s is inf"),
        ({"lever_m": 50.0}, r"lever_m is 50 m, but fingers .*in millimetres \(50 mm\)"),
        ({"motion_m": 0.2}, "motion_m is 200 mm, but a hand at rest moves by less than 10 mm"),
    ],
)
def test_an_equilibrium_that_makes_no_sense(values: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Equilibrium(**values)


def test_digests_follow_mesh_files_wherever_they_lie(tmp_path: Path) -> None:
    digests = []
    for name, size in (("a", 120), ("b", 120), ("c", 121)):
        path = write_urdf_jaws(tmp_path / name, palm=MESH)
        trimesh.creation.box((size, 60, 40)).export(tmp_path / name / "palm.stl")
        digests.append(gripper_digest(load_gripper(path)))
    assert digests[0] == digests[1] != digests[2]
